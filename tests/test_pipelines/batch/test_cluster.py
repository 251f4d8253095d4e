"""The workers of a Dask cluster: encrypted, or not without a word."""

import re
import shutil
import subprocess
from importlib.util import find_spec
from types import SimpleNamespace

import pytest

from ema.core.errors import InputError
from pipelines.batch import workers as batch_cluster
from pipelines.batch.campaigns import CampaignFolder, Task
from pipelines.batch.state import DONE, BatchFolder, Fingerprint, Record
from pipelines.batch.workers import on_cluster
from pipelines.results.options import Options

needs_dask = pytest.mark.skipif(
    find_spec("distributed") is None, reason="dask.distributed is not installed"
)


@pytest.fixture
def tasks(tmp_path):
    folder = BatchFolder(tmp_path / "out")
    return [
        Task(CampaignFolder(name, name, tmp_path / name), folder, Options())
        for name in (f"tyre_{k}" for k in range(8))
    ]


@pytest.fixture
def certificate(tmp_path):
    """What a Dask configuration says of a certificate that signs itself, made for the test."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    cert, key = str(tmp_path / "cert.pem"), str(tmp_path / "key.pem")
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=test"]
    subprocess.run([*command, "-keyout", key, "-out", cert], check=True, capture_output=True)
    tls = "distributed.comm.tls"
    roles = [f"{tls}.{role}" for role in ("scheduler", "worker", "client")]
    pairs = {f"{role}.cert": cert for role in roles} | {f"{role}.key": key for role in roles}
    return {f"{tls}.ca-file": cert, **pairs}


def working(task):
    return Record(task.campaign.name, DONE, Fingerprint("", ()))


def never_connect(monkeypatch):
    """Fail as a connection is tried."""

    def client(address, timeout):
        raise AssertionError(address)

    monkeypatch.setattr(batch_cluster, "_imported", lambda: SimpleNamespace(Client=client))


@needs_dask
def test_an_encrypted_scheduler_is_reached_with_the_certificates_of_dasks_configuration(
    tasks, certificate
):
    import dask
    from distributed import LocalCluster, Security

    said = []
    with dask.config.set(certificate):
        cluster = LocalCluster(
            n_workers=1,
            processes=False,
            dashboard_address=None,
            protocol="tls://",
            security=Security(),
        )
        with cluster:
            address = cluster.scheduler_address
            records = list(on_cluster(tasks, working, address, said.append))
    assert {record.campaign for record in records} == {task.campaign.name for task in tasks}
    assert said == []
    # Without a certificate nobody gets in, and the message says where it is looked for.
    with pytest.raises(InputError) as refused:
        list(on_cluster(tasks, working, "tls://127.0.0.1:9", said.append))
    assert "distributed.comm.tls" in refused.value.remedy


@needs_dask
@pytest.mark.parametrize("allowed", [False, True])
def test_one_of_this_machine_without_encryption_is_used_with_a_warning(tasks, allowed):
    from distributed import LocalCluster

    said = []
    with LocalCluster(
        n_workers=1, processes=False, dashboard_address=None, protocol="tcp://", host="127.0.0.1"
    ) as cluster:
        address = cluster.scheduler_address
        records = list(on_cluster(tasks, working, address, said.append, allow_unencrypted=allowed))
    assert {record.campaign for record in records} == {task.campaign.name for task in tasks}
    assert len(said) == (0 if allowed else 1)


@pytest.mark.parametrize(
    "address",
    ["tcp://node1:8786", "node1:8786", "10.0.0.7:8786", "ws://node1:80", "tcp://[fe80::1]:8786"],
)
def test_one_that_other_machines_reach_without_encryption_is_refused(tasks, address, monkeypatch):
    never_connect(monkeypatch)
    with pytest.raises(InputError) as refused:
        list(on_cluster(tasks, working, address, str))
    assert batch_cluster.ALLOW in refused.value.remedy
    with pytest.raises(AssertionError, match=r".*"):  # confirmed: a connection is tried
        list(on_cluster(tasks, working, address, str, allow_unencrypted=True))


@pytest.mark.parametrize(
    ("address", "n_warnings"),
    [
        ("tcp://127.0.0.1:8786", 1),
        ("localhost:8786", 1),
        ("tcp://[::1]:8786", 1),
        ("tls://127.0.0.1:8786", 0),
        ("TLS://node1:8786", 0),
    ],
)
def test_only_an_unencrypted_one_of_this_machine_is_warned_of(
    tasks, address, n_warnings, monkeypatch
):
    never_connect(monkeypatch)
    said = []
    with pytest.raises(AssertionError):
        list(on_cluster(tasks, working, address, said.append))
    assert len(said) == n_warnings


def test_the_command_refuses_it_too(ringmodal, short_campaign, tmp_path):
    shutil.copytree(short_campaign, tmp_path / "root" / "tyre")
    out = tmp_path / "out"
    code, _, errors = ringmodal(
        *("batch", tmp_path / "root", "--out", out, "--scheduler", "tcp://192.0.2.1:8786")
    )
    assert code == 2
    assert batch_cluster.ALLOW in errors


@pytest.mark.parametrize("answer", ["99.0", ImportError("No module named 'pipelines'")])
def test_workers_without_this_version_are_refused(answer):
    def result():
        if isinstance(answer, ImportError):
            raise answer
        return answer

    client = SimpleNamespace(submit=lambda work, pure: SimpleNamespace(result=result))
    with pytest.raises(InputError, match=r"tcp://far:1.*(99\.0|No module).*the same ringmodal"):
        batch_cluster._require_same_version(client, "tcp://far:1")


@needs_dask
def test_no_scheduler_is_told(tasks, monkeypatch):
    monkeypatch.setattr(batch_cluster, "_CONNECT_S", 0.2)
    for address in ("tcp://127.0.0.1:9", "localhost:nonsense"):
        with pytest.raises(InputError, match=re.escape(address)):
            list(on_cluster(tasks, working, address, str))


def test_a_cluster_asks_for_what_is_missing(tasks, monkeypatch):
    monkeypatch.setattr(batch_cluster, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install distributed"):
        list(on_cluster(tasks, working, "tls://nowhere:8786", str))
