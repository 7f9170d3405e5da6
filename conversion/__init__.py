"""One module a source, each with one ``open_recording``; found by entry point only."""
