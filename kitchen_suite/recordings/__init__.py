"""Many episodes recorded, as Minari datasets, replayed and compared."""
