"""Public data sets known by name: where they come from, what they may be used for, how they are read.

The idea: `resolve("slotting")` and `resolve("my/folder")` give the same thing. A known name is looked for in
the folder that the environment variable MJX_CUTTING_DATA names (laid out as <folder>/slotting/...,
<folder>/drilling/...), then in the user's cache, then downloaded from the public source, pinned by commit and
SHA-256. Nothing of the data is part of this package.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mjx_cutting import _platform
from mjx_cutting.trials.dataset import Dataset
from mjx_cutting.trials.download import RETRIES, VARIABLE, RemoteFile, check_folder, download, is_cached
from mjx_cutting.trials.importers import drilling, slotting


@dataclass(frozen=True)
class PublicData:
    """One public data set: what it is, its source and licence, its files, and the importer that reads
    them.
    """

    name: str
    title: str
    source_url: str
    licence: str
    base_url: str
    files: tuple[RemoteFile, ...]
    load: Callable[[Path], Dataset]

    @property
    def size_bytes(self) -> int:
        """Size of all files [bytes]."""
        return sum(file.size_bytes for file in self.files)


def _slot(feed: int, sha256: str, size_bytes: int) -> RemoteFile:
    name = f"6-n6000f{feed}ap3ae25.csv"
    return RemoteFile(name, name, sha256, size_bytes)


CATALOGUE: dict[str, PublicData] = {
    "slotting": PublicData(
        name="slotting",
        title="full slots at five feeds, 6,000 rpm, 25 mm end mill, 2 teeth, 10 kHz",
        source_url="https://github.com/leekunhwee/ForceCalculation",
        licence=slotting.LICENCE,
        base_url="https://raw.githubusercontent.com/leekunhwee/ForceCalculation/"
        "3fda341f3e196644e8d13328b6e858118fcad5d8/General/Flat%20end%20milling",
        files=(
            _slot(300, "637b395e5414b440a786bdf80d1a89227517a32464702c5029f4f2d37c17e36b", 314585),
            _slot(600, "c5a28fcba554522eaab7e690122994e718abc48305f17ea043806093ffdce6e8", 314059),
            _slot(900, "2dabb24a58b9899e2f4482a24eae5ccf79d908262463f403f71ad605030dd0f3", 313613),
            _slot(1200, "cf9d63482bb85ab42cec02e139817362d888de39abba866c597a38551227e2da", 313489),
            _slot(1500, "908e6ef1d72bcb2b94dca2c6efe1b01be77d09227400c40c9f7ec37aeebf3e97", 313417),
        ),
        load=slotting.import_slotting,
    ),
    "drilling": PublicData(
        name="drilling",
        title="thrust and torque of 334 holes by 14 drills, run to failure, arbitrary units",
        source_url="https://github.com/ArnabBir/Condition_Based_Maintenance",
        licence=drilling.LICENCE,
        base_url="https://raw.githubusercontent.com/ArnabBir/Condition_Based_Maintenance/"
        "a8bb334881ce0adf8f188a0f56671b0f55136ef5/matData",
        files=(
            RemoteFile(
                "dbhole.mat",
                "dbhole.mat",
                "67ac5e8ef08a6cec2271734c23607cae25ff25c875ea65e77047be56bb3c8b2a",
                1209112,
            ),
        ),
        load=drilling.import_drilling,
    ),
}


def cache_folder() -> Path:
    """Where downloads are kept: `data` in this package's cache folder ($MJX_CUTTING_CACHE moves it)."""
    return _platform.cache_folder() / "data"


def locate(name: str, *, cache: Path | None = None) -> Path | None:
    """The folder that holds a known data set already, checked, or None where it would have to be downloaded.

    Raises ValueError for an unknown name, or where the copy below MJX_CUTTING_DATA is not the pinned one.
    """
    data = _known(name)
    given = os.environ.get(VARIABLE)
    if given and (Path(given) / name).is_dir():
        check_folder(Path(given) / name, data.files)
        return Path(given) / name
    cached = (cache or cache_folder()) / name
    return cached if is_cached(cached, data.files) else None


def fetch(
    name: str,
    *,
    cache: Path | None = None,
    base_url: str | None = None,
    retries: int = RETRIES,
    progress: bool = True,
) -> Path:
    """The folder that holds a known data set, downloaded where need be.

    Arguments: name; cache, a folder instead of the user's cache; base_url instead of the public source (a
    mirror); retries; progress, whether to show a bar.

    Raises ValueError for an unknown name or a wrong local copy, DownloadError where the data cannot be had.
    """
    data = _known(name)
    found = locate(name, cache=cache)
    if found is not None:
        return found
    return download(
        data.files,
        base_url or data.base_url,
        (cache or cache_folder()) / name,
        retries=retries,
        progress=progress,
    )


def resolve(
    name_or_folder: str | os.PathLike[str],
    *,
    cache: Path | None = None,
    base_url: str | None = None,
    progress: bool = True,
) -> Dataset:
    """The dataset behind a name that `mjx-cutting data list` shows, or in a folder in the dataset format.

    A known name wins over a folder of that name; write ./slotting for the folder.

    Raises ValueError where it is neither or is broken, DownloadError where a known data set cannot be had.
    """
    if isinstance(name_or_folder, str) and name_or_folder in CATALOGUE:
        folder = fetch(name_or_folder, cache=cache, base_url=base_url, progress=progress)
        return CATALOGUE[name_or_folder].load(folder)
    path = Path(name_or_folder)
    if not path.exists():
        raise ValueError(
            f"{path}: got neither a known data set nor a folder, expected {', '.join(CATALOGUE)} or a "
            "dataset folder; check the spelling."
        )
    from mjx_cutting.trials.reading import read

    return read(path)


def _known(name: str) -> PublicData:
    if name not in CATALOGUE:
        raise ValueError(
            f"{name}: got an unknown data set, expected {' or '.join(CATALOGUE)}; `mjx-cutting data list` "
            "shows them."
        )
    return CATALOGUE[name]
