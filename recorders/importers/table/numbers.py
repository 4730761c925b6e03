"""Numbers of a column exactly: the whole part, and billionths of the rest."""

from __future__ import annotations

from typing import Final

import polars as pl

NUMBER: Final = r"^[+-]?(?:\d+(?:[.,]\d+)*|[.,]\d+)(?:[eE][+-]?\d+)?$"
BILLION: Final = 10**9

_MOST: Final = 9.2e18  # near the largest int64
_PLAIN: Final = r"^([+-]?)(\d*)(?:\.(\d*))?$"


def split_numbers(values: pl.Series, decimal: str = "") -> pl.DataFrame:
    """Return columns `whole` and `billionths` (of the same sign), null where a value is no finite number.

    Args:
        values: texts, integers, floats or decimals.
        decimal: sign of texts, "." or ","; "" for what the texts themselves say.
    """
    if values.dtype.is_integer():
        wide = values.cast(pl.Int64, strict=False)
        return pl.DataFrame({"whole": wide, "billionths": pl.zeros(len(wide), pl.Int64, eager=True)})
    if values.dtype.is_float():
        return _split_floats(values.cast(pl.Float64))
    texts = values.cast(pl.String).str.strip_chars()
    return _split_texts(with_points(texts, decimal))


def _split_floats(values: pl.Series) -> pl.DataFrame:
    frame = pl.DataFrame({"value": values}).with_columns(
        pl.when(pl.col("value").is_finite() & (pl.col("value").abs() < _MOST)).then("value").alias("value")
    )
    floor = pl.col("value").floor()
    # the difference of a float and its floor is exact, so the billionths are rounded once
    rest = ((pl.col("value") - floor) * BILLION).round()
    return frame.select(floor.cast(pl.Int64).alias("whole"), rest.cast(pl.Int64).alias("billionths"))


def _split_texts(texts: pl.Series) -> pl.DataFrame:
    parts = pl.DataFrame({"text": texts.rename("text")}).with_columns(
        pl.col("text").str.extract_groups(_PLAIN).struct.rename_fields(["sign", "digits", "rest"]).alias("parts")
    )
    parts = parts.unnest("parts").with_columns(pl.col("rest").fill_null(""))
    sign = pl.when(pl.col("sign") == "-").then(-1).otherwise(1).cast(pl.Int64)
    digits = pl.when((pl.col("digits") == "") & (pl.col("rest") != "")).then(pl.lit("0")).otherwise("digits")
    # digits beyond the ninth are rounded by the tenth
    beyond = pl.col("rest").str.slice(9, 1).cast(pl.Int64, strict=False).fill_null(0) >= 5
    billionths = pl.col("rest").str.slice(0, 9).str.pad_end(9, "0").cast(pl.Int64) + beyond.cast(pl.Int64)
    plain = parts.select(
        (sign * digits.cast(pl.Int64, strict=False)).alias("whole"), (sign * billionths).alias("billionths"), "text"
    )
    has_exponent = plain["whole"].is_null() & texts.str.contains(NUMBER).fill_null(value=False)
    if not has_exponent.any():
        return plain.select("whole", "billionths")
    floats = _split_floats(texts.cast(pl.Float64, strict=False))
    return pl.DataFrame(
        {
            name: pl.select(pl.when(has_exponent).then(floats[name]).otherwise(plain[name])).to_series()
            for name in floats.columns
        }
    )


def with_points(texts: pl.Series, decimal: str = "") -> pl.Series:
    """Return the texts of numbers with a decimal point and no other sign between their digits.

    The sign that comes last is the decimal one, unless it comes several times.

    Args:
        texts: as they are in the file.
        decimal: sign of all of them, "." or ","; "" for what each text itself says.
    """
    if not texts.str.contains(",", literal=True).any():
        return texts
    text = pl.col("text")
    if decimal:
        other = "," if decimal == "." else "."
        points = text.str.replace_all(other, "", literal=True).str.replace(",", ".", literal=True)
    else:
        is_comma_last = text.str.contains(r",[^.,]*$")
        commas, dots = text.str.count_matches(",", literal=True), text.str.count_matches(r"\.")
        points = (
            pl.when(is_comma_last & (commas == 1))
            .then(text.str.replace_all(".", "", literal=True).str.replace(",", ".", literal=True))
            .when((dots > 1) & (commas == 0))
            .then(text.str.replace_all(".", "", literal=True))
            .otherwise(text.str.replace_all(",", "", literal=True))
        )
    return pl.DataFrame({"text": texts.rename("text")}).select(points.alias(texts.name)).to_series()
