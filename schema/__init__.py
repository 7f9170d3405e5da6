"""The law of the format: JSON Schemas (2020-12). Data only."""
