"""Export of fitted models to simulators, autopilots and firmware."""

import sys

from benchtool import CallablePackage

sys.modules[__name__].__class__ = CallablePackage
