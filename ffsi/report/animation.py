"""Moving pictures of a computation in time, from the states that it has saved."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ffsi.files.errors import InputError
from ffsi.files.steps import SavedStep
from ffsi.hemodynamics.result import Result
from ffsi.result import pictures

DPI = 72
SECONDS = 8.0
"""Length of an animation with many frames."""
FRAME = (0.04, 0.5)
"""Shortest and longest time of one frame, s."""
_COLOURS = 256
_SHORT = 6  # digits, at most, that a time has before or after its point
_SAMPLES = 4


def write_animation(result: Result, name: str, output: Path) -> int:
    """Write `velocity`, `pressure` or `displacement` of every saved step as a GIF; return the number of its frames.

    Raises:
        InputError: fewer than two steps were saved, or the scene has no such field.
    """
    data, count = moving(result, name)
    partial = output.with_name(f".{output.name}.part")
    partial.write_bytes(data)
    partial.replace(output)
    return count


def moving(result: Result, name: str, most: int | None = None, dpi: int = DPI) -> tuple[bytes, int]:
    """Return the saved steps of a field as a GIF, and the number of its frames: all of them, or at most `most`.

    All frames have the same colours and the same window; the time is in their titles. Each is shown equally long.

    Raises:
        InputError: fewer than two steps were saved, or the scene has no such field.
    """
    steps = result.saved_steps
    if len(steps) < 2:
        raise InputError(
            f"{result.directory} holds {len(steps)} saved time steps, an animation needs two or more; "
            "time.output_interval says how often fields are saved"
        )
    if most is not None and len(steps) > most:
        steps = [steps[i] for i in np.linspace(0, len(steps) - 1, most).round().astype(int)]
    try:
        scale = pictures.common_scale(name, (result.fields_of(step) for step in steps))
    except ValueError as error:
        raise InputError(f"{result.directory}: {error}") from error
    form = _form([step.time for step in steps])

    def frame(step: SavedStep) -> Image.Image:
        title = f"{result.data['case']}, t = {step.time:{form}} s"
        with Image.open(
            io.BytesIO(pictures.to_png(pictures.draw(name, result.fields_of(step), title, scale), dpi))
        ) as image:
            return image.convert("RGB")

    palette = _palette([frame(steps[(i + 1) * len(steps) // _SAMPLES - 1]) for i in range(_SAMPLES)])
    frames = [frame(step).quantize(palette=palette, dither=Image.Dither.NONE) for step in steps]
    seconds = float(np.clip(SECONDS / len(frames), *FRAME))
    buffer = io.BytesIO()
    frames[0].save(
        buffer, format="GIF", save_all=True, append_images=frames[1:], duration=round(1000 * seconds), loop=0
    )
    return buffer.getvalue(), len(frames)


def _form(times: Sequence[float]) -> str:
    """Return the format in which the times (s) of an animation differ, and are equally long."""
    digits = int(1 - np.floor(np.log10(times[-1] / len(times))))
    return f".{max(digits, 0)}f" if -_SHORT < digits <= _SHORT else f".{len(str(len(times)))}e"


def _palette(samples: Sequence[Image.Image]) -> Image.Image:
    """Return a picture whose palette fits all frames: one frame alone may lack the colours of the others."""
    width, height = samples[0].size
    together = Image.new("RGB", (width, height * len(samples)))
    for i, sample in enumerate(samples):
        together.paste(sample, (0, i * height))
    return together.quantize(_COLOURS, kmeans=1, dither=Image.Dither.NONE)
