"""The list of accepted bridges: data only, checked by schema/registry.schema.json."""
