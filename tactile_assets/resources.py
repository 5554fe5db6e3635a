"""The store: what assets keep, and what only this machine keeps."""

import logging
import os
import re
from collections.abc import Mapping
from pathlib import Path

import dagster as dg
import pandas as pd
from pydantic import Field
from upath import UPath

from tactile_core.errors import OutOfReachError, TactileError
from tactile_core.files import content_hash, is_local, remove_folder, stored_bytes, written_whole
from tactile_core.home import check_one_home, find_artifacts, find_home
from tactile_core.parquet import read_table
from tactile_core.spread import on_cluster

logger = logging.getLogger(__name__)

FIGURES = "figures"  # among the artifacts
STEPS = "steps"  # among them: what the steps inside `policies` hand each other, by run
SHOWN = re.compile(rf"\(/{FIGURES}/([^?]+)\?version=(\w+)\)")  # as `Store.picture` gives it


class Store(dg.ConfigurableResource):
    """The folders of the platform: what assets store, and what only this machine keeps."""

    home: str = Field(description="Local folder for caches and trainings under way.")
    artifacts: str = Field(description="Folder or fsspec URL that holds what the assets store.")

    @classmethod
    def from_environment(cls, environ: Mapping[str, str] = os.environ) -> "Store":
        """The home (see `tactile_core.home`) and `TACTILE_STORE` (default: artifacts/ in the home).

        Raises `TactileError` where the home cannot be used, or Dagster's is in another.
        """
        home = find_home(environ)
        check_one_home(home, environ)
        return cls(home=str(home), artifacts=find_artifacts(environ))

    def path(self, *parts: str) -> UPath:
        """A place among the artifacts."""
        return UPath(self.artifacts, *parts)

    def work(self, *parts: str) -> Path:
        """A local folder for downloads, checkpoints and TensorBoard curves."""
        return Path(self.home, "cache", *parts)

    def far_work(self, *parts: str) -> Path | UPath:
        """A place for the checkpoints of work that a Ray cluster takes over, where there is one: in
        the store, as another node may have to go on. Else the same local folder as `work`."""
        return self.path("cache", *parts) if on_cluster() else self.work(*parts)

    def claimed_folders(self) -> list[Path | UPath]:
        """What a run holds for itself: the home and, wherever they lie, the artifacts."""
        return [Path(self.home), self.path()]

    def local_folders(self) -> list[Path]:
        """The home and, where it is a folder that this machine sees, that of the artifacts."""
        artifacts = self.path()
        return [Path(self.home), *([Path(artifacts.path)] if is_local(artifacts) else [])]

    def forget_steps(self, run_id: str) -> None:
        """Remove what the steps inside `policies` handed each other in a run."""
        remove_folder(self.path(STEPS, run_id))

    def stored_steps(self) -> set[str]:
        """The runs whose steps have left something for each other."""
        steps = self.path(STEPS)
        return {folder.name for folder in steps.iterdir()} if steps.exists() else set()

    def previous(self, asset: str) -> pd.DataFrame | None:
        """The table that `asset` stored in an earlier run, if there is one and it is whole. Raises
        `OutOfReachError` where that cannot be told: mend the store before all is made anew."""
        try:
            return read_table(self.path(f"{asset}.parquet"))
        except OutOfReachError:
            raise
        except TactileError as error:
            logger.info("%s starts afresh: %s", asset, error)
            return None

    def picture(self, name: str, picture: bytes) -> dg.MarkdownMetadataValue:
        """Keep a PNG or GIF as a file among the figures, and show it in the UI.

        The UI shows by itself only Markdown below 1000 characters, so it is given the address at
        which `make ui` serves the figures; what else serves the UI shows the sentence instead.
        """
        with written_whole(self.path(FIGURES, name)) as file:
            file.write(picture)
        address = f"/{FIGURES}/{name}?version={content_hash(picture)}"
        sentence = f"{name} is shown by `make ui`, unless a later run has replaced it"
        return dg.MetadataValue.md(f"![{sentence}]({address}&small) [full size]({address})")

    def has_pictures(self, materialisation: dg.AssetMaterialization) -> bool:
        """Whether the pictures that a materialisation shows are there, as it kept them."""
        texts = [
            value.md_str or ""
            for value in materialisation.metadata.values()
            if isinstance(value, dg.MarkdownMetadataValue)
        ]
        try:
            return all(
                content_hash(stored_bytes(self.path(FIGURES, name))) == version
                for text in texts
                for name, version in SHOWN.findall(text)
            )
        except OSError:
            return False
