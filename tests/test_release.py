"""`make release` refuses a checkout that is not ready, and says what to do."""

import subprocess

import pytest

from eightpost import __version__
from release import check

CHANGELOG = (
    f"# Changelog\n\n## {__version__} (2026-01-02)\n\nEasy to install.\n\n- One command.\n\n## 0.0.1\n\n- First.\n"
)
CITATION = f"version: {__version__}\ndate-released: 2026-01-02\n"


@pytest.fixture
def checkout(tmp_path):
    """A repository with the files that the checks read, ready for a release."""
    (tmp_path / "CHANGELOG.md").write_text(CHANGELOG, encoding="utf-8")
    (tmp_path / "CITATION.cff").write_text(CITATION, encoding="utf-8")
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "All"]):
        options = ["-c", "user.name=Tester", "-c", "user.email=tester@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", *options, *words], cwd=tmp_path, check=True, capture_output=True)
    return tmp_path


@pytest.mark.parametrize("step", [check.check_tree, check.check_versions, check.check_changelog, check.check_tag])
def test_a_checkout_that_is_ready_passes(checkout, step):
    assert step(checkout)


def test_a_change_that_is_not_committed_is_named(checkout):
    (checkout / "CITATION.cff").write_text("", encoding="utf-8")
    with pytest.raises(check.NotReadyError, match=r"CITATION\.cff"):
        check.check_tree(checkout)


@pytest.mark.parametrize("name", ["CHANGELOG.md", "CITATION.cff"])
def test_a_file_with_another_version_is_named(checkout, name):
    text = (checkout / name).read_text(encoding="utf-8")
    (checkout / name).write_text(text.replace(__version__, "9.9.9"), encoding="utf-8")
    with pytest.raises(check.NotReadyError, match=rf"{name}: 9\.9\.9"):
        check.check_versions(checkout)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (CHANGELOG.replace("2026-01-02", "unreleased"), "needs a heading"),
        (CHANGELOG.replace("# Changelog\n", "# Changelog\n\n## Unreleased\n\n- More.\n"), "section Unreleased"),
        (CHANGELOG.replace("- One command.\n", ""), "lists no change"),
        (CHANGELOG.replace("2026-01-02", "2026-01-03"), "date-released: 2026-01-03"),
    ],
)
def test_a_changelog_that_is_not_finished_is_refused(checkout, text, reason):
    (checkout / "CHANGELOG.md").write_text(text, encoding="utf-8")
    with pytest.raises(check.NotReadyError, match=reason):
        check.check_changelog(checkout)


def test_a_version_that_was_released_is_refused(checkout):
    subprocess.run(["git", "tag", f"v{__version__}"], cwd=checkout, check=True)
    with pytest.raises(check.NotReadyError, match="raise the version"):
        check.check_tag(checkout)


def test_the_first_failing_check_ends_the_command_without_a_tag(monkeypatch, capsys):
    def refuse(root):
        raise check.NotReadyError("commit first")

    def never(root):
        pytest.fail("a check was run after one that failed")

    monkeypatch.setattr(check, "CHECKS", (refuse, never))
    assert check.main([]) == 1
    shown = capsys.readouterr()
    assert "NOT READY" in shown.err and "commit first" in shown.err and "git tag" not in shown.out


def test_after_the_checks_the_remaining_steps_name_the_tag_and_the_checked_files(checkout):
    (checkout / "dist").mkdir()
    for name in (f"eightpost-{__version__}.tar.gz", f"eightpost-{__version__}-py3-none-any.whl"):
        (checkout / "dist" / name).touch()
    text = check.steps_text(checkout)
    assert check.tag_text() in text and f"git tag -a v{__version__}" in text and "make pythons" in text
    assert f"twine upload dist/eightpost-{__version__}-py3-none-any.whl dist/eightpost-{__version__}.tar.gz" in text
