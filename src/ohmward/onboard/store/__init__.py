"""The store on board: rows of battery and drive in SQLite, finished days in Parquet; see docs/store.md."""
