"""The domains of the suite, each a record of plain data and a builder in a module of its own; `suite.DOMAINS` has all.

Importing these modules does not import dm_control: the builders do, when they are called.
"""
