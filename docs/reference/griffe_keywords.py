"""Extension of griffe: signature and docstring of calls whose keywords are those of an input class.

The page docs/reference/python.md reads sources; these keywords exist at run time only.
"""

from __future__ import annotations

import inspect
from typing import Any

import griffe

from benchtool import api


class Keywords(griffe.Extension):
    """Add the keywords of `benchtool.core.keywords.with_keywords`."""

    def on_module_members(self, *, mod: griffe.Module, **kwargs: Any) -> None:
        if mod.filepath.suffix == ".pyi":  # its functions hide the packages of their names
            mod.members.clear()

    def on_function(self, *, func: griffe.Function, loader: Any, **kwargs: Any) -> None:
        call = getattr(api, func.name, None)
        if not hasattr(call, "keyword_help") or func.docstring is None:
            return
        if call.__module__ != func.module.path:
            return
        func.docstring.value = inspect.getdoc(call)
        shown = inspect.signature(call).parameters
        fixed = [item for item in func.parameters if item.name in shown]
        names = {item.name for item in fixed}
        func.parameters = griffe.Parameters(
            *fixed,
            *(
                griffe.Parameter(
                    name,
                    annotation=item.annotation,
                    kind=griffe.ParameterKind.keyword_only,
                    default=repr(item.default),
                )
                for name, item in shown.items()
                if name not in names
            ),
        )
