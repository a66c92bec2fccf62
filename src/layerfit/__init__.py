"""layerfit: optical properties of layered, turbid samples from light measurements."""

import lazy_loader

from ._precision import use_double_precision

use_double_precision()

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
