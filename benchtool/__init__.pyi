from types import ModuleType

from benchtool.api import *  # noqa: F403

__version__: str

class CallablePackage(ModuleType): ...
