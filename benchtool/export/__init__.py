"""Files by which simulators, autopilots and firmware take what was fitted."""

import sys

from benchtool import CallablePackage

sys.modules[__name__].__class__ = CallablePackage
