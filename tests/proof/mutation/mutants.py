"""Where a module can be broken: cosmic-ray's operators and the deletion of a statement.

Left out is what no test should judge: annotations, docstrings, f-strings (the numbers in
messages), decorators, imports, and assertions for the type checker.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator
from parso.python.tree import Keyword

ARITHMETIC = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul", "Mod_FloorDiv", "Pow_Mul",
              "BitAnd_BitOr", "BitOr_BitAnd", "LShift_RShift", "RShift_LShift")  # fmt: skip
COMPARISONS = ("Eq_NotEq", "NotEq_Eq", "Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE",
               "GtE_Gt", "GtE_Lt", "Is_IsNot", "IsNot_Is")  # fmt: skip
OTHERS = ("AddNot", "ExceptionReplacer", "NumberReplacer", "ReplaceAndWithOr", "ReplaceOrWithAnd",
          "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ReplaceFalseWithTrue",
          "ReplaceTrueWithFalse", "ReplaceUnaryOperator_Delete_Not",
          "ReplaceUnaryOperator_USub_UAdd", "ZeroIterationForLoop")  # fmt: skip
"""Each exchange and its boundary once; cosmic-ray's 180 others are the same places again."""


class DeleteStatement(Operator):
    """Put `pass` in place of a call, return, raise, del, or assignment to what outlives it.

    A plain local name is not left unassigned: any test that reached it would end in a NameError.
    """

    def mutation_positions(self, node):
        if node.type == "simple_stmt" and self._deletes(node.children[0]):
            yield node.start_pos, node.end_pos

    def mutate(self, node, index):
        first = node.children[0]
        prefix = first.get_first_leaf().prefix
        node.children[0] = Keyword("pass", first.start_pos, prefix)
        return node

    @staticmethod
    def _deletes(first) -> bool:
        if first.type == "expr_stmt":
            target, sign = first.children[:2]
            augmented = getattr(sign, "value", "=") not in ("=", None)
            outlives = target.type in ("atom_expr", "power", "testlist_star_expr")
            assigned = sign.type != "annassign" or len(sign.children) > 2
            return augmented or (outlives and assigned)
        return first.type in ("atom_expr", "power", "return_stmt", "raise_stmt", "del_stmt")

    @classmethod
    def examples(cls):
        return ()


@cache
def operators() -> dict[str, Operator]:
    """Return every operator by name."""
    names = [
        *(f"ReplaceBinaryOperator_{name}" for name in ARITHMETIC),
        *(f"ReplaceComparisonOperator_{name}" for name in COMPARISONS),
        *OTHERS,
    ]
    return {name: get_operator(f"core/{name}")() for name in names} | {
        "DeleteStatement": DeleteStatement()
    }


@dataclass(frozen=True)
class Mutant:
    """Name one change: the occurrence of an operator in a module."""

    module: str
    operator: str
    occurrence: int
    line: int

    def applied(self, source: str) -> str:
        """Return the module's source with the change."""
        return mutate_code(source, operators()[self.operator], self.occurrence)


def mutants_of(module: str, source: str) -> Iterator[Mutant]:
    """Yield every mutant of a module."""
    spared, tree = list(_spared(ast.parse(source))), get_ast(source)
    lines = source.splitlines()
    for name, operator in operators().items():
        places = (
            start for node in ast_nodes(tree) for start, _ in operator.mutation_positions(node)
        )
        for occurrence, start in enumerate(places):
            star = lines[start[0] - 1].startswith("*,", start[1])  # of a signature, no product
            if not star and not any(low <= start < high for low, high in spared):
                yield Mutant(module, name, occurrence, start[0])


def _spared(tree: ast.Module) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Yield the ranges, each (line, column) twice, that are not to be changed."""
    for node in ast.walk(tree):
        for inner in _spared_of(node):
            low, high = (inner.lineno, inner.col_offset), (inner.end_lineno, inner.end_col_offset)
            yield low, (high[0] or 0, high[1] or 0)


def _spared_of(node: ast.AST) -> list[Any]:
    match node:
        case ast.JoinedStr() | ast.Assert() | ast.Import() | ast.ImportFrom():
            return [node]
        case ast.Expr(value=ast.Constant()) | ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return [node]
        case ast.ClassDef():
            return node.decorator_list
        case ast.FunctionDef():
            return [*node.decorator_list, *filter(None, [node.returns])]
        case ast.arg() | ast.AnnAssign():
            return [*filter(None, [node.annotation])]
    return []
