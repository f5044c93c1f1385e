"""Answers as flat records, one dictionary a row: what pandas.DataFrame, csv.DictWriter and polars
take."""

from __future__ import annotations

import math
from typing import Any, Mapping

Record = dict[str, Any]


def flat(value: Mapping[str, Any], prefix: str = "") -> Record:
    """Nested objects with dots in their keys: {"a": {"b": 1}} as {"a.b": 1}. Lists stay values."""
    record: Record = {}
    for key, entry in value.items():
        if isinstance(entry, Mapping):
            record.update(flat(entry, f"{prefix}{key}."))
        else:
            record[prefix + key] = entry
    return record


def episode_record(row: Mapping[str, Any]) -> Record:
    """A row of a result: its metrics under their own names, the rest as flat() has it."""
    return _with_metrics(row, "metrics")


def board_record(row: Mapping[str, Any]) -> Record:
    """A row of a leaderboard, with the metrics of its `aggregate` under their own names."""
    return _with_metrics(row, "aggregate")


def numbers_of(aggregate: Mapping[str, Any]) -> Record:
    """The numbers of a result's `aggregate` by name, with half of the 95 % interval of each ranked metric as
    METRIC.error. None stands for what the result does not have, and for what is not finite."""
    errors = {f"{metric}.error": (spread["high"] - spread["low"]) / 2 if spread else None
              for metric, spread in aggregate["spread"].items()}
    return {name: number if isinstance(number, (int, float)) and math.isfinite(number) else None
            for name, number in flat({**aggregate, "spread": {}, **errors}).items()}


def marks_of(status: Mapping[str, Any]) -> dict[str, Record]:
    """The marks that a submission has, by its status, each with the act that set it: `reason`, `who`, `at`."""
    last = {act["mark"]: act for act in status["marks"]}
    return {mark: act for mark, act in last.items() if act["set"]}


def _with_metrics(row: Mapping[str, Any], key: str) -> Record:
    record: Record = {}
    for name, value in row.items():
        if name != key:
            record.update(flat({name: value}))
            continue
        for metric, number in flat(value or {}).items():
            record.setdefault(metric, number)
    return record
