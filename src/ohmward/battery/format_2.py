"""Battery files of format 2, in which the capacity stood at the head and once more in each model."""

from __future__ import annotations

from typing import Any

from ohmward.errors import InputError

#: Tables of the models, which have the capacity of the battery.
MODELS = ("thevenin", "rc")


def from_format_2(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a file of today for one of format 2.

    Raises:
        InputError: the capacities differ, as in a file in which one was edited; which one is meant nobody can know.
    """
    for model in MODELS:
        if not isinstance(table.get(model), dict) or "capacity_Ah" not in table[model]:
            continue
        rest = dict(table[model])
        capacity_Ah = rest.pop("capacity_Ah")
        if capacity_Ah != table.get("capacity_Ah", capacity_Ah):
            raise InputError(
                f"capacity_Ah is {table['capacity_Ah']} at the head and {capacity_Ah} in [{model}]; write the right "
                f"one at the head and remove the one in [{model}]"
            )
        table = table | {model: rest}
    return table
