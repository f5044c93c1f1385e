"""Pictures of an environment (render_mode="rgb_array"), drawn by the extension off screen."""

from __future__ import annotations

from typing import Any, Mapping, Optional

import numpy as np

from ..errors import MyogradeError, WrongUse
from . import extension, kinds

# Keys of a camera. Those that are left out are those of the track's own camera.
CAMERA = ("body", "look_at", "distance", "azimuth", "elevation")


class Pictures:
    """The renderer of one environment, created with the first picture."""

    def __init__(self, core: Any, width: int, height: int,
                 camera: Optional[Mapping[str, Any]] = None) -> None:
        """core: a _env.Environment. WrongUse for an unknown key of `camera` or an invalid value."""
        kinds.check(width=width, height=height, camera=camera)
        for name in camera or {}:
            if name not in CAMERA:
                raise WrongUse(f'a camera has no "{name}"; it has: {", ".join(CAMERA)}')
        kinds.check(**{name: value for name, value in (camera or {}).items() if value is not None})
        self._core = core
        self._size = (width, height)
        self._camera = dict(camera or {})
        self._renderer: Any = None

    def draw(self) -> np.ndarray:
        """The current state: height x width x 3 uint8, a new array. WrongUse for an unknown body; MyogradeError without
        OSMesa on this machine."""
        try:
            if self._renderer is None:
                self._renderer = extension.load().Renderer(self._core, *self._size)
            return self._renderer.draw(**self._camera)
        except ValueError as error:
            raise WrongUse(str(error)) from error
        except RuntimeError as error:
            raise MyogradeError(str(error)) from error

    def close(self) -> None:
        """Frees the memory of OpenGL. The next picture allocates it again."""
        self._renderer = None
