"""The on-disk format: bridge folders and datasets, read and written."""
