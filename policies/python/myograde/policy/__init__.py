"""The kit: a policy is a class with reset and act, handed to serve(). Only a policy that is graded needs the package
`lcm`, which the runtime "python" of a grader has."""

from .kit import Episode, Policy, serve
from .layout import Layout, Part, Track, track, tracks
from .leg import BODY_WEIGHT_N, Joint, LegSet, LegState, Threshold, leg_sets

__all__ = ["BODY_WEIGHT_N", "Episode", "Joint", "Layout", "LegSet", "LegState", "Part", "Policy",
           "Threshold", "Track", "leg_sets", "serve", "track", "tracks"]
