"""Grades the submissions of a challenge that is held on EvalAI or Codabench. configs/EVALAI.md is the
page for organisers; `python -m myograde.connect --help` has the commands."""
