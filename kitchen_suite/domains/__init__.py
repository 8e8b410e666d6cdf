"""The domains of the suite, each a record of plain data in a module of its own; `suite.DOMAINS` has all.

Importing these modules does not import dm_control: a record names its scene and its task, and imports them when used.
"""
