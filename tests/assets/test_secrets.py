"""A password in the address of the meshes stays in the environment."""

import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tests.assets.running import shell
from tests.core.dataset.mesh_files import MUG, V2, make_zip, obj


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format, *args):
        pass


@pytest.mark.parametrize("there", [True, False], ids=["a run that succeeds", "a run that fails"])
def test_nothing_that_a_run_leaves_has_the_secret_of_an_address(tmp_path, there):
    """Its home with Dagster's database, and what it prints, are searched for it."""
    site, home = tmp_path / "site", tmp_path / "home"
    site.mkdir()
    for synset in (MUG, "02876657") if there else ():
        make_zip(site / f"{synset}.zip", {f"{synset}/{synset[:3]}/{V2}": obj()})
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    address = f"http://user:hushhush@127.0.0.1:{server.server_port}/?X-Amz-Signature=hushhush"
    command = "dagster asset materialize --select shapenet_meshes"
    done = shell(command, home, TACTILE_SHAPENET=address, NO_PROXY="127.0.0.1")
    server.shutdown()
    server.server_close()
    assert (done.returncode == 0) is there, done.stderr
    assert f"127.0.0.1:{server.server_port}" in done.stdout + done.stderr
    assert "hushhush" not in done.stdout + done.stderr
    files = [path for path in home.rglob("*") if path.is_file()]
    assert any(path.suffix == ".db" for path in files)
    assert [path.name for path in files if b"hushhush" in path.read_bytes()] == []
