"""Pictures from a file. Beside `sweeps.bench`, only this room imports matplotlib."""
