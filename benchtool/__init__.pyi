from types import ModuleType

from benchtool.api import Effect as Effect
from benchtool.api import Model as Model
from benchtool.api import Result as Result
from benchtool.api import Rig as Rig
from benchtool.api import explain as explain
from benchtool.api import fit as fit
from benchtool.api import load_model as load_model
from benchtool.api import load_rig as load_rig
from benchtool.api import pool as pool
from benchtool.api import read as read
from benchtool.api import runs as runs
from benchtool.api import simulate_flight as simulate_flight
from benchtool.api import simulate_pitch as simulate_pitch

__version__: str

class CallablePackage(ModuleType): ...
