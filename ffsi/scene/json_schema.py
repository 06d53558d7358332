"""The JSON schema of a scene, for editors and other programs: what a TOML file can hold, and what goes together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaMode, JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

Rule = dict[str, Any]


class SceneJsonSchema(GenerateJsonSchema):
    """Differs from pydantic's own: TOML has no null, and a table that is one of several says which one it is."""

    def generate(self, schema: CoreSchema, mode: JsonSchemaMode = "validation") -> JsonSchemaValue:
        """Return the schema, with the dialect that it is written in."""
        return {"$schema": self.schema_dialect, **super().generate(schema, mode)}

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Leave out titles that only repeat the key."""
        return False

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """Return the schema of what is there if anything is."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Return the schema with its default, unless that is to be absent."""
        found = super().default_schema(schema)
        return {key: value for key, value in found.items() if key != "default" or value is not None}

    def function_before_schema(self, schema: core_schema.BeforeValidatorFunctionSchema) -> JsonSchemaValue:
        """Let a table go without the key that its validator fills in."""
        found = super().function_before_schema(schema)
        if schema["schema"]["type"] == "tagged-union":
            filled: dict[str, Any] = schema["function"]["function"]({})  # type: ignore[call-arg]
            for choice in found["oneOf"]:
                mapping = found["discriminator"]["mapping"]
                if choice["$ref"] in [mapping.get(value) for value in filled.values()]:
                    del choice["required"]
        return found

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> JsonSchemaValue:
        """Return the choices, each with the key that chooses it."""
        found = super().tagged_union_schema(schema)
        if callable(schema["discriminator"]):  # one table or several, which their form tells
            return found
        found["oneOf"] = [{**choice, "required": [schema["discriminator"]]} for choice in found["oneOf"]]
        return found


def at(key: str, value: Rule) -> Rule:
    """Return the rule that a dotted key is there and its value obeys another rule."""
    for name in reversed(key.split(".")):
        value = {"required": [name], **({"properties": {name: value}} if value else {})}
    return value


def given(*keys: str) -> Rule:
    """Return the rule that dotted keys are there."""
    return every(at(key, {}) for key in keys)


def absent(*keys: str) -> Rule:
    """Return the rule that none of the dotted keys is there."""
    return every({"not": given(key)} for key in keys)


def equals(key: str, *values: object) -> Rule:
    """Return the rule that a dotted key has one of some values."""
    return at(key, {"enum": list(values)})


def every(rules: Iterable[Rule]) -> Rule:
    """Return the rule that all rules hold."""
    found = [rule for rule in rules if rule]
    return found[0] if len(found) == 1 else {"allOf": found} if found else {}


def some(*rules: Rule) -> Rule:
    """Return the rule that at least one holds."""
    return {"anyOf": list(rules)}


def when(condition: Rule, then: Rule, otherwise: Rule | None = None) -> Rule:
    """Return the rule that one holds where a condition does, and another one, if any, elsewhere."""
    return {"if": condition, "then": then} | ({} if otherwise is None else {"else": otherwise})


def one_of(choices: Iterable[Iterable[str]]) -> Rule:
    """Return the rule that exactly the keys of one choice are there, of all that are in any."""
    sets = [set(keys) for keys in choices]
    known = set().union(*sets)
    return {"oneOf": [every([given(*sorted(keys)), absent(*sorted(known - keys))]) for keys in sets]}
