"""Downloads from real servers on loopback: resumed, verified, cached, and refused clearly."""

import errno
import hashlib
import os
import traceback

import pytest
import requests
import urllib3
from hypothesis import given
from hypothesis import strategies as st
from upath import UPath

from tactile_core.dataset.sources import answers
from tactile_core.dataset.sources import download as download_module
from tactile_core.dataset.sources.answers import HuggingFaceToken, MissingFileError
from tactile_core.dataset.sources.cache import PIECE, Reporter, copy_object, object_version
from tactile_core.dataset.sources.download import download, remote_version
from tactile_core.errors import OutOfReachError, TactileError

BODY = os.urandom(3 << 20)


def get(url, folder, **options):
    return download(url, folder, first_wait=0.01, **options)


def refusal(url, folder, **options) -> str:
    """The message of the error that `download` must raise: one line."""
    with pytest.raises(TactileError) as caught:
        get(url, folder, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_file_arrives_whole_and_progress_tells_percent_and_megabytes(make_store, tmp_path):
    store, said = make_store(body=BODY), []
    path = get(store.url, tmp_path, progress=said.append)
    assert path.read_bytes() == BODY
    assert path.name == "03797390.zip"
    assert said[-1] == "03797390.zip: 100 % of 3.1 MB"
    assert not list(tmp_path.rglob("*.part"))


def test_a_second_run_asks_whether_it_has_changed_and_fetches_nothing(make_store, tmp_path):
    store = make_store(body=BODY)
    first = get(store.url, tmp_path)
    assert get(store.url, tmp_path) == first
    assert store.sent == len(BODY)
    assert store.requests[1][1]["If-None-Match"] == '"1"'


def test_a_server_that_ignores_conditions_is_believed_by_its_headers(make_store, tmp_path):
    """It sends the file once more, of which nothing but the headers is read."""
    store, said = make_store(body=BODY, conditions=False), []
    first = get(store.url, tmp_path)
    assert get(store.url, tmp_path, progress=said.append) == first
    assert said == []
    store.etag = '"2"'
    get(store.url, tmp_path, progress=said.append)
    assert said != []


def test_a_changed_file_is_fetched_again(make_store, tmp_path):
    store = make_store(body=BODY)
    get(store.url, tmp_path)
    store.body, store.etag = b"new", '"2"'
    assert get(store.url, tmp_path).read_bytes() == b"new"


def test_pythons_own_server_is_asked_by_date(site, tmp_path):
    file = site.folder / "a.zip"
    file.write_bytes(BODY)
    os.utime(file, (1e9, 1e9))
    get(f"{site.url}/a.zip", tmp_path)
    get(f"{site.url}/a.zip", tmp_path)
    assert [status for _, _, status in site.log] == [200, 304]
    file.write_bytes(b"new")
    assert get(f"{site.url}/a.zip", tmp_path).read_bytes() == b"new"


def test_a_cached_file_that_was_cut_short_is_fetched_again(make_store, tmp_path):
    store = make_store(body=BODY)
    path = get(store.url, tmp_path)
    path.write_bytes(BODY[:100])
    assert get(store.url, tmp_path).read_bytes() == BODY


def test_a_download_that_breaks_goes_on_where_it_stopped(make_store, tmp_path):
    store = make_store(body=BODY, breaks=[20 * PIECE, 10 * PIECE])
    assert get(store.url, tmp_path).read_bytes() == BODY
    assert [headers.get("Range") for _, headers in store.requests] == [
        None,
        f"bytes={20 * PIECE}-",
        f"bytes={30 * PIECE}-",
    ]
    assert store.sent == len(BODY)


def test_a_line_that_breaks_often_is_borne_as_long_as_bytes_come(make_store, tmp_path):
    store = make_store(body=BODY, breaks=[PIECE] * 20)
    assert get(store.url, tmp_path).read_bytes() == BODY


def test_a_later_run_goes_on_where_the_last_one_gave_up(make_store, tmp_path):
    store = make_store(body=BODY, breaks=[20 * PIECE] + [0] * 5)
    assert "03797390.zip cannot be fetched" in refusal(store.url, tmp_path)
    store.requests.clear()
    assert get(store.url, tmp_path).read_bytes() == BODY
    assert store.requests[0][1]["Range"] == f"bytes={20 * PIECE}-"
    assert store.sent == len(BODY)


def test_a_file_that_changes_between_break_and_resumption_is_never_mixed(make_store, tmp_path):
    store = make_store(body=BODY, breaks=[20 * PIECE] + [0] * 5)
    refusal(store.url, tmp_path)
    store.body, store.etag = BODY[::-1], '"2"'
    assert get(store.url, tmp_path).read_bytes() == BODY[::-1]


@pytest.mark.parametrize("body", [BODY[::-1], BODY[::-1] + b"and more"])
def test_a_server_that_does_not_know_if_range_mixes_no_files(make_store, tmp_path, body):
    store = make_store(body=BODY, breaks=[20 * PIECE] + [0] * 5, knows_if_range=False)
    refusal(store.url, tmp_path)
    store.body, store.etag = body, '"2"'
    assert get(store.url, tmp_path).read_bytes() == body
    store.breaks, store.etag = [20 * PIECE], '"3"'  # within one run, the rest is still its own
    assert get(store.url, tmp_path).read_bytes() == body


def test_a_length_that_is_sent_twice_is_one_and_one_that_is_none_is_none(make_store, tmp_path):
    size = str(len(BODY))
    for length in (f"{size}, {size}", "as long as it takes"):
        store = make_store(body=BODY, length=length)
        assert get(store.url, tmp_path).read_bytes() == BODY


@pytest.mark.parametrize(
    "odd", ["http://a..b/x.zip", f"http://{'a' * 64}.example/x.zip", "http://[::1/x.zip"]
)
def test_what_is_no_address_is_told_in_one_line_wherever_it_comes_from(make_store, tmp_path, odd):
    store = make_store(body=BODY, redirect=odd)
    for url in {odd, store.url} - {"http://[::1/x.zip"}:
        assert "cannot be fetched" in refusal(url, tmp_path)


@pytest.mark.parametrize("record", [b"[]", b"\xff", b"{", b'{"length": "none"}', bytes(40)])
def test_a_damaged_record_is_the_same_as_none(make_store, tmp_path, record):
    store = make_store(body=BODY)
    path = get(store.url, tmp_path)
    path.with_name(f"{path.name}.json").write_bytes(record)
    assert get(store.url, tmp_path).read_bytes() == BODY


@pytest.mark.parametrize("etag", [None, 'W/"1"'])
def test_without_a_strong_validator_a_broken_download_starts_over(make_store, tmp_path, etag):
    store = make_store(body=BODY, etag=etag, breaks=[20 * PIECE])
    assert get(store.url, tmp_path).read_bytes() == BODY
    assert ["Range" in headers for _, headers in store.requests] == [False, False]


def test_a_server_without_ranges_starts_over(make_store, tmp_path):
    store = make_store(body=BODY, ranges=False, breaks=[20 * PIECE])
    assert get(store.url, tmp_path).read_bytes() == BODY
    assert store.requests[1][1]["Range"] == f"bytes={20 * PIECE}-"


def test_a_part_longer_than_the_file_starts_over(make_store, tmp_path):
    store = make_store(body=BODY, breaks=[20 * PIECE] + [0] * 5)
    refusal(store.url, tmp_path)
    store.body = BODY[:1000]  # shorter, under the same ETag
    assert get(store.url, tmp_path).read_bytes() == BODY[:1000]


def test_failures_that_pass_are_retried(make_store, tmp_path):
    store = make_store(body=BODY, status=[503, 429, 500])
    assert get(store.url, tmp_path).read_bytes() == BODY


def test_the_wait_that_a_server_asks_for_is_kept(make_store, tmp_path, caplog):
    store = make_store(body=b"x", status=[429], retry_after="1")
    with caplog.at_level("INFO", logger=download_module.__name__):
        get(store.url, tmp_path)
    assert "status 429, next attempt in 1.0 s" in caplog.text


def test_failures_that_stay_end_in_one_clear_line(make_store, tmp_path):
    store = make_store(status=[503] * 10)
    message = refusal(store.url, tmp_path)
    assert store.url in message
    assert "status 503, 5 times in a row" in message
    assert len(store.requests) == 5


def test_a_server_that_is_not_there_is_named(tmp_path):
    assert "http://127.0.0.1:9/a.zip cannot be fetched (no connection" in refusal(
        "http://127.0.0.1:9/a.zip", tmp_path
    )


@pytest.mark.parametrize("status", [401, 403])
def test_refused_access_speaks_of_the_server_that_refused(make_store, tmp_path, status):
    store = make_store(status=[status])
    message = refusal(store.url, tmp_path)
    assert f"refuses access ({status}): 127.0.0.1 wants a user and a password" in message
    assert "HF_TOKEN" not in message and "Hugging Face" not in message
    assert len(store.requests) == 1  # asking again would not help


def test_refused_access_at_hugging_face_says_to_accept_the_licence_and_set_a_token():
    said = answers.how_to_enter("https://huggingface.co/datasets/a.zip")
    assert "accept the licence" in said and "HF_TOKEN" in said
    assert "HF_TOKEN" not in answers.how_to_enter("https://huggingface.co.example.org/a")


def test_a_missing_file_is_told_at_once(make_store, tmp_path):
    store = make_store(status=[404])
    with pytest.raises(MissingFileError, match=r"03797390\.zip does not exist \(404\)"):
        get(store.url, tmp_path)
    assert len(store.requests) == 1


def test_messages_keep_secrets_in_the_address_to_themselves(make_store, tmp_path):
    store = make_store(status=[404])
    url = store.url.replace("http://", "http://user:secret@") + "?key=secret"
    assert "secret" not in refusal(url, tmp_path)
    assert "secret" not in refusal("http://user:secret@127.0.0.1:9/a.zip?key=secret", tmp_path)


def test_another_checksum_is_refused_and_nothing_is_kept(make_store, tmp_path):
    store = make_store(body=BODY)
    message = refusal(store.url, tmp_path, sha256="0" * 64)
    assert hashlib.sha256(BODY).hexdigest() in message
    assert "0" * 64 in message
    assert not list(tmp_path.rglob("*.zip")) + list(tmp_path.rglob("*.part"))


def test_a_cached_file_with_the_expected_checksum_needs_no_server(make_store, tmp_path):
    store = make_store(body=BODY)
    sha256 = hashlib.sha256(BODY).hexdigest().upper()
    first = get(store.url, tmp_path, sha256=sha256)
    assert get(store.url, tmp_path, sha256=sha256) == first
    assert len(store.requests) == 1


def test_equal_names_at_different_addresses_are_kept_apart(make_store, tmp_path):
    one, two = make_store(body=b"one"), make_store(body=b"two")
    paths = [get(store.url, tmp_path) for store in (one, two)]
    assert [path.read_bytes() for path in paths] == [b"one", b"two"]


def test_a_version_is_asked_by_head_and_follows_the_file(make_store):
    store = make_store(body=BODY)
    before = remote_version(store.url)
    assert remote_version(store.url) == before
    store.etag = '"2"'
    assert remote_version(store.url) != before
    assert {method for method, _ in store.requests} == {"HEAD"}


@pytest.mark.parametrize(("etag", "alike"), [('"1"', True), ('W/"1"', False)])
def test_what_a_strong_etag_vouches_for_may_have_been_put_there_anew(make_store, etag, alike):
    store = make_store(body=BODY, etag=etag, modified="Sat, 28 Nov 2026 10:00:00 GMT")
    before = remote_version(store.url)
    store.modified = "Sat, 28 Nov 2026 11:00:00 GMT"
    assert (remote_version(store.url) == before) == alike


def test_a_server_that_knows_no_head_is_asked_by_get_of_which_nothing_is_read(make_store):
    store = make_store(body=BODY, head=405)
    before = remote_version(store.url)
    store.etag = '"2"'
    assert before and remote_version(store.url) != before
    assert [method for method, _ in store.requests] == ["HEAD", "GET"] * 2


def test_a_server_that_tells_no_version_gives_an_empty_one(make_store):
    """Its length alone would miss a file that was replaced by one as long."""
    assert remote_version(make_store(body=BODY, etag=None).url) == ""


def test_no_error_and_no_log_has_an_address_with_its_password_or_query(tmp_path, caplog):
    hidden = "s3" + "cret"  # whole in no line of code, which tracebacks show
    address = f"http://user:{hidden}@127.0.0.1:9/a.zip?X-Amz-Signature={hidden}"
    with pytest.raises(TactileError) as caught, caplog.at_level("DEBUG"):
        get(address, tmp_path)
    assert hidden not in "".join(traceback.format_exception(caught.value))
    assert hidden not in caplog.text and "a.zip" in caplog.text


@pytest.mark.parametrize(
    ("url", "allowed"),
    [
        ("https://huggingface.co/datasets/ShapeNet/ShapeNetCore/resolve/main/a.zip", True),
        ("http://huggingface.co/a.zip", False),
        ("https://huggingface.co.example.com/a.zip", False),
        ("https://example.com/huggingface.co/a.zip", False),
        ("https://huggingface.co@example.com/a.zip", False),
        ("https://example.com#@huggingface.co/a.zip", False),
        ("https://example.com\\@huggingface.co/a.zip", False),
        ("https://cdn-lfs.huggingface.co/a.zip", False),  # signed addresses take no token
        ("https://huggingface.co:8443/a.zip", False),
    ],
)
def test_the_token_is_for_hugging_face_alone(url, allowed):
    """Asked of the address as `requests` would really use it."""
    prepared = requests.Request("GET", url, auth=HuggingFaceToken("secret")).prepare()
    assert (prepared.headers.get("Authorization") == "Bearer secret") is allowed


@given(st.lists(st.sampled_from(["huggingface.co", "evil.com", *"@:/\\#?. a"]), max_size=8))
def test_no_address_however_odd_takes_the_token_to_another_host(pieces):
    request = requests.Request("GET", "https://" + "".join(pieces), auth=HuggingFaceToken("secret"))
    try:
        prepared = request.prepare()
    except requests.RequestException:
        return
    if "Authorization" in prepared.headers:
        assert urllib3.util.parse_url(prepared.url).host == "huggingface.co"


def test_no_token_is_sent_to_other_hosts(make_store, tmp_path):
    store = make_store(body=BODY)
    get(store.url, tmp_path, token="secret")
    assert "Authorization" not in store.requests[0][1]


def test_a_token_leaves_a_users_netrc_in_force(make_store, tmp_path, monkeypatch):
    store = make_store(body=BODY)
    (tmp_path / "netrc").write_text("machine 127.0.0.1 login user password secret\n")
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))
    get(store.url, tmp_path, token="secret")
    assert store.requests[0][1]["Authorization"].startswith("Basic ")


def test_a_redirect_to_another_host_takes_no_token_along(make_store, tmp_path, monkeypatch):
    """As from Hugging Face to its storage; here the rule names the first server instead."""
    storage = make_store(body=BODY)
    storage_url = storage.url.replace("127.0.0.1", "localhost")
    hub = make_store(redirect=storage_url)
    monkeypatch.setattr(answers, "takes_token", lambda url: url.startswith(hub.url))
    assert get(hub.url, tmp_path, token="secret").read_bytes() == BODY
    assert hub.requests[0][1]["Authorization"] == "Bearer secret"
    assert "Authorization" not in storage.requests[0][1]


def test_an_object_of_a_store_is_copied_once_and_again_when_it_changes(tmp_path):
    source, said = UPath("memory://bucket/a.zip"), []
    source.write_bytes(BODY)
    path = copy_object(source, tmp_path, said.append)
    assert path.read_bytes() == BODY
    assert said[-1] == "a.zip: 100 % of 3.1 MB"
    said.clear()
    assert copy_object(source, tmp_path, said.append) == path
    assert said == []
    source.write_bytes(b"new")
    assert copy_object(source, tmp_path, said.append).read_bytes() == b"new"


def test_where_a_file_system_tells_no_time_an_object_is_copied_each_time(tmp_path, monkeypatch):
    source = UPath("memory://bucket/b.zip")
    told = type(source.fs).info
    monkeypatch.setattr(
        type(source.fs), "info", lambda *args, **rest: {**told(*args, **rest), "created": None}
    )
    for data in (b"old", b"new"):
        source.write_bytes(data)
        assert copy_object(source, tmp_path, print).read_bytes() == data
    assert object_version({"size": 3, "created": None}) is None
    assert object_version({"size": 3, "modify": "20261129"}) != object_version(
        {"size": 3, "modify": "20261130"}
    )


def test_a_full_disk_is_no_fault_of_the_network(tmp_path, monkeypatch):
    source = UPath("memory://bucket/c.zip")
    source.write_bytes(BODY)

    def full(*args):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Reporter, "at", full)  # told after each piece that was written
    with pytest.raises(TactileError, match="is full: make room there") as caught:
        copy_object(source, tmp_path, print)
    assert not isinstance(caught.value, OutOfReachError)
