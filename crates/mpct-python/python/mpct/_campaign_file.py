"""The results file of a campaign: Parquet or CSV, always whole."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ._campaign_work import OUTCOME
from ._errors import argument, argument_type
from ._atomic import write_atomically

Row = dict[str, Any]
_TEXT = {True: "true", False: "false"}


def _pyarrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    return pyarrow


def plain(value: Any) -> Any:
    """A parameter as numbers, texts and lists."""
    if isinstance(value, np.ma.MaskedArray):
        value = value.filled(np.nan)
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    return value


def path_of(results: str | PathLike[str]) -> Path:
    """The results file; one without suffix is Parquet when pyarrow is there, else CSV."""
    try:
        path = Path(results)
    except TypeError:
        raise argument_type("results", "the path of a file", repr(results)) from None
    if path.is_dir():
        raise argument("results", "a file", f"the folder {path}")
    if path.suffix == "":
        return path.with_suffix(".csv" if _pyarrow() is None else ".parquet")
    if path.suffix not in (".csv", ".parquet"):
        raise argument("results", "a file that ends in .parquet or .csv", repr(str(path)))
    if path.suffix == ".parquet" and _pyarrow() is None:
        raise ImportError("Parquet files need pyarrow: pip install 'mpct[campaign]', or let results end in .csv")
    return path


def _flat(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, (list, dict)) else value


def write(path: Path, rows: Sequence[Row], parameters: Sequence[str]) -> None:
    """Writes all rows; lists as JSON text."""
    names = ["run", *parameters, "seed", *OUTCOME, "key"]
    if path.suffix == ".csv":
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(names)
        for row in rows:
            flat = [_flat(row.get(name)) for name in names]
            writer.writerow(["" if v is None else _TEXT[v] if isinstance(v, bool) else v for v in flat])
        write_atomically(path, text.getvalue().encode())
        return
    pa = _pyarrow()
    kinds = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string(), list: pa.string()}
    known = {"run": pa.int64(), "seed": pa.uint64(), "key": pa.string(), **{k: kinds[v] for k, v in OUTCOME.items()}}
    columns, fields = [], []
    for name in names:
        values: list[Any] = [_flat(row.get(name)) for row in rows]
        kind = known.get(name)
        if kind is None:
            found = {type(v) for v in values if v is not None}
            if found <= {int, float} and float in found:
                found = {float}
            if found == {int} and any(not -(2**63) <= v < 2**63 for v in values if v is not None):
                found = set()  # beyond the integers of Parquet
            if len(found) == 1 and (one := found.pop()) in kinds:
                kind = kinds[one]
            else:  # values of several kinds in one column
                kind, values = pa.string(), [None if v is None else str(v) for v in values]
        columns.append(pa.array(values, type=kind))
        fields.append(pa.field(name, kind))
    sink = pa.BufferOutputStream()
    pa.parquet.write_table(pa.table(columns, schema=pa.schema(fields)), sink)
    write_atomically(path, sink.getvalue().to_pybytes())


def _value(text: Any, kind: type) -> Any:
    if text is None:
        return None
    if kind is list:
        return json.loads(text)
    if isinstance(text, str) and kind is not str:
        return text == "true" if kind is bool else kind(text)
    return text


def read(path: Path) -> dict[str, Row]:
    """The outcomes in a results file, by the key of their run."""
    try:
        if path.suffix == ".csv":
            # A weight of many states is long as text.
            limit = csv.field_size_limit(1 << 30)
            try:
                with path.open(encoding="utf-8", newline="") as file:
                    reader = csv.DictReader(file)
                    rows: list[dict[str, Any]] = [{k: v or None for k, v in row.items() if k} for row in reader]
                    if missing := {"run", "key", *OUTCOME} - set(reader.fieldnames or ()):
                        raise ValueError(f"its first line has no {sorted(missing)[0]!r}")
            finally:
                csv.field_size_limit(limit)
        else:
            rows = _pyarrow().parquet.read_table(path).to_pylist()
        return {row["key"]: {name: _value(row[name], kind) for name, kind in OUTCOME.items()} for row in rows}
    except OSError:
        raise
    except Exception as error:
        raise argument("results", "a results file of a campaign", f"{path}, which is none: {error!r}") from error
