"""Plans, writes, runs and checks the exports of a model, for every target of `table.py`."""
