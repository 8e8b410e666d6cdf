"""The microwave_table domain: the door of a microwave on a table is to be opened."""
