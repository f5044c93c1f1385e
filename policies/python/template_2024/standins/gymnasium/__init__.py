"""The one class of gymnasium that the template needs, for agents that bring no gymnasium."""

from . import spaces
