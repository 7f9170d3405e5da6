"""The nouns: frozen values that every room shares. No behaviour beyond refusing nonsense."""
