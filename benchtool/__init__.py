"""Control of rotor test benches near surfaces, and fits of ground-effect models.

`import benchtool as bt` provides the commands as functions: `bt.read`, `bt.sweep`, `bt.record`,
`bt.fit`, `bt.pool`, `bt.motor`, `bt.explain`, `bt.export`, `bt.simulate_pitch`,
`bt.simulate_flight`, with `bt.Model`, `bt.Rig` and `bt.Effect`. They are defined in
`benchtool.api`, imported on first use.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"
__all__ = [
    "Effect", "Model", "Result", "Rig", "__version__", "compare", "explain", "export",
    "figure_style", "fit", "fly", "load_model", "load_rig", "motor", "pool", "read", "record",
    "runs", "simulate_flight", "simulate_pitch", "sweep",
]  # fmt: skip


class CallablePackage(ModuleType):
    """Callable package with the name of a public function, for example `bt.fit(...)`.

    `import benchtool.fit` replaces the attribute `fit` of `benchtool` by the package, so the
    package itself must be callable like the function.
    """

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self.__wrapped__(*args, **options)

    @property
    def __doc__(self) -> str:  # type: ignore[override]
        """The signature and docstring of the function, for `help`."""
        import inspect
        import re
        import textwrap

        signature = inspect.signature(self.__wrapped__)
        untyped = [item.replace(annotation=item.empty) for item in signature.parameters.values()]
        text = f"{self.__wrapped__.__name__}{inspect.Signature(untyped)}"
        text = re.sub(r"<function (\w+) at \w+>", r"\1", text)
        title, _, rest = str(self.__wrapped__.__doc__).partition("\n")
        return f"{title}\n\n{textwrap.fill(text, 96, subsequent_indent='    ')}\n{rest}"

    @property
    def __wrapped__(self) -> Any:
        """The function, for `help` and `inspect.signature`."""
        return getattr(import_module("benchtool.api"), self.__name__.rpartition(".")[2])


def __getattr__(name: str) -> object:
    if name in ("fit", "explain", "export"):
        return import_module(f"benchtool.{name}")
    if name in __all__:
        return getattr(import_module("benchtool.api"), name)
    raise AttributeError(f"module 'benchtool' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
