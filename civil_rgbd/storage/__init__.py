"""Files on this machine or on object storage, by one face: a path."""
