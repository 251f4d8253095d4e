"""Folders of small campaigns, some of them broken, each in its own way."""

import shutil

from pipelines.results.options import Options

# One run of twelve sensors and few model orders: as little work as still gives eight orders.
QUICK = Options(max_order=20, tune=False)
GOOD = ("2025/tyre_1", "2025/tyre_2")
BROKEN = {
    "force silent": ("a constant signal", "excite"),
    "key unknown": ("'spacing'", "not known"),
    "manifest missing": ("no campaign.toml", "ringmodal init"),
    "manifest no TOML": ("campaign.toml", "TOML"),
    "recording missing": ("'config_1.uff'", "does not exist"),
    "recording truncated": ("config_1.uff", "truncated"),
}
NAMES = tuple(sorted((*GOOD, *BROKEN)))
_SILENT = """schema = 1
[excitation]
channel = "force"
[[runs]]
file = "run.csv"
"""


def write_campaign(source, folder):
    """A campaign of the first run of another one."""
    folder.mkdir(parents=True)
    shutil.copy(source / "config_1.uff", folder)
    head, first, *_ = (source / "campaign.toml").read_text().split("[[runs]]")
    (folder / "campaign.toml").write_text(f"{head}[[runs]]{first}")
    return folder


def write_fleet(source, root):
    """Campaigns that can be processed, and one for each way of being broken."""
    for name in (*GOOD, *BROKEN):
        write_campaign(source, root / name)
    edit(root / "key unknown", "positions = 72", "positions = 72\nspacing = 5")
    (root / "manifest missing" / "campaign.toml").unlink()
    edit(root / "manifest no TOML", "schema = 1", "schema = ")
    (root / "recording missing" / "config_1.uff").unlink()
    cut(root / "recording truncated" / "config_1.uff", 200_000)
    silence(root / "force silent")
    return root


def edit(campaign, old, new):
    """Replace a text in a manifest."""
    manifest = campaign / "campaign.toml"
    text = manifest.read_text()
    assert old in text
    manifest.write_text(text.replace(old, new))


def cut(path, n_bytes):
    """Keep the beginning of a file."""
    path.write_bytes(path.read_bytes()[:n_bytes])


def silence(campaign):
    """Replace a campaign by one whose force is constant."""
    (campaign / "config_1.uff").unlink()
    rows = "\n".join(f"{k / 100},1.0,{(k * 7) % 5}" for k in range(2000))
    (campaign / "run.csv").write_text(f"time [s],force [N],A01 [m/s^2]\n{rows}\n")
    (campaign / "campaign.toml").write_text(_SILENT)
