"""Settings for engines that ship: YAML, the file's stem is the engine's name. Data only."""
