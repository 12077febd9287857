"""Find where simulation and measurement disagree and name the missing effect."""

import sys

from benchtool import CallablePackage

sys.modules[__name__].__class__ = CallablePackage
