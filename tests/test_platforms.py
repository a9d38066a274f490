"""Calls that only some systems have stand behind a question for the system."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from gmwm.cli.main import NAMES

PACKAGE = Path(__file__).resolve().parent.parent / "src" / "gmwm"
POSIX_ONLY = {
    f"{module}.{name}"
    for module, names in {
        "os": "chown fchmod fchown fork forkpty getegid geteuid getgid getloadavg getpgid getpgrp getuid kill killpg "
        "mkfifo mknod nice openpty posix_fadvise pread preadv pwrite readv register_at_fork sched_getaffinity "
        "sched_setaffinity sendfile setsid statvfs sysconf uname wait wait3 wait4 waitpid writev",
        "signal": "SIGALRM SIGCHLD SIGHUP SIGKILL SIGPIPE SIGQUIT SIGUSR1 SIGUSR2 alarm pause pthread_kill "
        "pthread_sigmask setitimer siginterrupt sigpending sigtimedwait sigwait",
        "time": "pthread_getcpuclockid tzset",
    }.items()
    for name in names.split()
}
"""Names that the documentation of Python marks as not available on Windows. `os.kill` ends a process there."""
POSIX_MODULES = {"fcntl", "resource", "termios", "tty", "pty", "pwd", "grp", "readline", "syslog", "curses", "posix"}
NAMED = re.compile(rf"\b(?:{'|'.join(map(re.escape, POSIX_ONLY | POSIX_MODULES))})\b")
QUESTIONS = ("hasattr(", "getattr(", "sys.platform", "os.name", "_WINDOWS", "ImportError")


def posix_calls(tree: ast.Module) -> Iterator[tuple[str, ast.AST, list[ast.AST]]]:
    """Each name that not every system has, with the statements around it."""
    parents = {child: parent for parent in ast.walk(tree) for child in ast.iter_child_nodes(parent)}
    for node in ast.walk(tree):
        name = None
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            name = f"{node.value.id}.{node.attr}"
            name = name if name in POSIX_ONLY else None
        elif isinstance(node, ast.Import):
            name = next((item.name for item in node.names if item.name in POSIX_MODULES), None)
        elif isinstance(node, ast.ImportFrom):
            name = node.module if node.module in POSIX_MODULES else None
        if name is not None:
            around, parent = [], node
            while parent in parents:
                parent = parents[parent]
                around.append(parent)
            yield name, node, around


def is_guarded(around: list[ast.AST]) -> bool:
    """Whether a statement around, or an earlier one of its function that returns, asks for the system."""
    function = next((node for node in around if isinstance(node, ast.FunctionDef)), None)
    inside = around[: around.index(function) + 1] if function else around[:-1]
    return any(question in ast.unparse(node) for node in inside for question in QUESTIONS)


def unguarded(source: str) -> list[str]:
    """The names that are used without a question for the system."""
    tree = ast.parse(source if NAMED.search(source) else "")
    return [name for name, _, around in posix_calls(tree) if not is_guarded(around)]


def test_no_call_of_some_systems_is_made_on_all():
    places = {
        str(path.relative_to(PACKAGE)): names
        for path in PACKAGE.rglob("*.py")
        if (names := unguarded(path.read_text(encoding="utf-8")))
    }
    # Only called behind `_WINDOWS`, in _remove_leftovers.
    assert places == {"base/atomic_files.py": ["os.kill"]}


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("import os\nos.fork()", ["os.fork"]),
        ("import os\nif hasattr(os, 'fork'):\n    os.fork()", []),
        ("def f():\n    import fcntl", ["fcntl"]),
        ("try:\n    import fcntl\nexcept ImportError:\n    fcntl = None", []),
        ("import os\ndef f():\n    if os.name == 'nt':\n        return 1\n    return os.getuid()", []),
    ],
)
def test_a_call_is_recognised_as_guarded(source, names):
    assert unguarded(source) == names


# --- examples in every shell --------------------------------------------------------------------------

SHELL_BLOCK = re.compile(r"^```(?:sh|bash|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_examples_quote_as_every_shell_does():
    """cmd takes single quotes for a part of the word."""
    root = PACKAGE.parent.parent
    pages = [root / "README.md", *(root / "docs").rglob("*.md")]
    blocks = [block for page in pages for block in SHELL_BLOCK.findall(page.read_text(encoding="utf-8"))]
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    commands = [line for line in lines if re.match(r"\s*(\$ )?(gmwm|pip) ", line)]
    commands += [example for name in NAMES for example in getattr(import_module(f"gmwm.cli.{name}"), "EXAMPLES", ())]
    assert len(commands) > 100
    assert [command for command in commands if "'" in command] == []
