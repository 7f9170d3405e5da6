"""Training recipes that ship: TOML, the file's stem is the recipe's name. Data only."""
