"""Operands of a program in C: numbers that it computes itself, plain ones, and parameters."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias


class ExpressionNode(NamedTuple):
    """A real number that the program computes, by its number in the program."""

    number: int


class ParameterRow(NamedTuple):
    """Contiguous parameters, as of tables: C gets a pointer to the first one."""

    values: tuple[float, ...]


Operand: TypeAlias = ExpressionNode | float
FOLDED_NUMBERS = (0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5)  # numbers that are literals in the program: others are parameters


class OperandNames:
    """Names of a program's operands in C; numbers become ``parameters`` at first use."""

    def __init__(self, parameters: list[float]):
        self._parameters = parameters
        self._places: dict[float | ParameterRow, int] = {x: k for k, x in enumerate(parameters)}

    def __call__(self, operand: Operand | ParameterRow) -> str:
        if isinstance(operand, ExpressionNode):
            return f"t{operand.number}"
        row = isinstance(operand, ParameterRow)
        if not row and operand in FOLDED_NUMBERS:
            return f"({operand!r})" if operand < 0.0 else repr(operand)
        if operand not in self._places:
            self._places[operand] = len(self._parameters)
            self._parameters.extend(operand.values if isinstance(operand, ParameterRow) else [operand])
        place = self._places[operand]
        return f"(p + {place})" if row else f"p[{place}]"
