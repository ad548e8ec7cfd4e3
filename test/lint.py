# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The form of the sources, checked by tools of Debian 12 (group [lint] of scripts/packages.txt). scripts/lint runs it, and so
does scripts/run_tests; clang-tidy needs the build directory of scripts/build --with-tests."""
import ast
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
# Other versions of the clang tools format and warn differently.
CLANG = r'version 14\.'
# clang-tidy takes 3 to 10 s for each of these files, and 20 to 45 s for each that includes ROS.
WITHOUT_ROS = ('src/core/', 'src/tools/')
TEXT_ENDINGS = {'.cpp', '.hpp', '.py', '.md', '.rst', '.txt', '.msg', '.cfg', '.launch', '.yaml', '.yml', '.xml', ''}
# What codespell takes for a misspelt word: kInf, to and fro.
SPELLING_IGNORED = 'kinf,fro'


def git(*arguments):
    """Lines that git says; None if it is not installed, or refuses."""
    if not shutil.which('git'):
        return None
    done = subprocess.run(['git', *arguments], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return done.stdout.splitlines() if done.returncode == 0 else None


def tracked_files():
    """Files under version control and new ones; in a plain source archive everything outside build/."""
    names = git('ls-files', '--cached', '--others', '--exclude-standard')
    if names is None:
        names = [str(path.relative_to(ROOT)) for path in ROOT.rglob('*')
                 if path.relative_to(ROOT).parts[0] not in ('build', 'demo_output') and '__pycache__' not in path.parts]
    return sorted(name for name in set(names) if (ROOT / name).is_file())


FILES = tracked_files()


def ending(*endings):
    return [name for name in FILES if name.endswith(endings)]


def with_interpreter(word):
    """Scripts without an ending whose first line names this interpreter."""
    return [name for name in FILES if '.' not in Path(name).name
            and re.match(rb'#!.*\b' + word, (ROOT / name).read_bytes()[:80])]


def python_files():
    return ending('.py', '.cfg') + with_interpreter(b'python3')


def need(program, version=''):
    """Not every system has every tool, or the version whose findings are those of others."""
    if not shutil.which(program):
        pytest.skip(f'{program} is not installed')
    if version and not re.search(version, subprocess.run([program, '--version'], capture_output=True, text=True).stdout):
        pytest.skip(f'{program} is not {version}')


def check(program, *arguments):
    """Fails with what the program finds."""
    need(program)
    done = subprocess.run([program, *map(str, arguments)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True)
    if done.returncode:
        pytest.fail(done.stdout.strip() or f'exit code {done.returncode}', pytrace=False)


def test_clang_format():
    need('clang-format', CLANG)
    check('clang-format', '--dry-run', '-Werror', *ending('.cpp', '.hpp'))


def changes():
    """(commit, files that differ from it): where this branch left origin/main, else the newest tag, else the last commit."""
    head = git('rev-parse', 'HEAD')
    for name in ('origin/main', *(git('describe', '--tags', '--abbrev=0') or []), 'HEAD~1'):
        base = git('merge-base', 'HEAD', name)
        if base and base != head:
            return name, {*git('diff', '--name-only', *base), *git('ls-files', '--others', '--exclude-standard')}
    return None, None


def with_includers(changed):
    """These files, those that include a file of their names, those that include these, and so on."""
    includes = {name: set(re.findall(r'^#include ".*?([\w.]+)"', (ROOT / name).read_text(), re.M))
                for name in ending('.cpp', '.hpp')}
    found, more = set(), set(changed)
    while more:
        found |= more
        names = {Path(name).name for name in more}
        more = {name for name in includes if includes[name] & names} - found
    return found


def tidy_sources(every=False):
    """(sources that clang-tidy checks, why these)"""
    sources = [name for name in ending('.cpp') if name.startswith('src/')]
    if every:
        return sources, 'all'
    since, changed = changes()
    if since is None:
        return [name for name in sources if name.startswith(WITHOUT_ROS)], 'those without ROS, for git knows no older commit'
    return sorted(with_includers(changed) & set(sources)), f'what has changed since {since}, and what includes it'


def test_clang_tidy(request, tmp_path):
    need('clang-tidy', CLANG)
    build = Path(request.config.getoption('--build'))
    assert (build / 'compile_commands.json').exists(), 'run scripts/build --with-tests first'
    sources, why = tidy_sources(request.config.getoption('--every-file'))
    print(f'{len(sources)} files: {why}')
    # clang cannot read headers that gcc has compiled. Without them it also finds what a source has forgotten to include.
    database = (build / 'compile_commands.json').read_text()
    (tmp_path / 'compile_commands.json').write_text(re.sub(r'-Winvalid-pch -include \S+', '', database))
    # Warnings that only gcc knows are no concern of clang's. Its -Wconversion warns of signs as well, gcc's does not.
    command = ['run-clang-tidy', '-quiet', '-p', tmp_path, '-extra-arg=-Wno-unknown-warning-option',
               '-extra-arg=-Wno-sign-conversion']
    if sources:
        check(*command, *[f'{re.escape(str(ROOT / name))}$' for name in sources])


def test_shellcheck():
    check('shellcheck', '-x', *with_interpreter(b'(bash|sh)'), *ending('.sh'))


def test_flake8():
    check('flake8', *python_files())


def test_python_3_8():
    """Noetic's Python must be able to read every program."""
    findings = []
    for name in python_files():
        try:
            ast.parse((ROOT / name).read_text(), name, feature_version=(3, 8))
        except SyntaxError as error:
            findings.append(f'{name}:{error.lineno}: {error.msg} (Python 3.8)')
    assert not findings


def test_catkin_lint():
    # Programs for the source tree only (builds, benchmarks, training, tests) are not installed. The folder of the fusion lies
    # in that of the nodelets.
    ignored = ('uninstalled_script', 'uninstalled_target', 'ambiguous_include_path')
    check('catkin_lint', '--quiet', '--strict', *[word for name in ignored for word in ('--ignore', name)], '.')


def test_codespell():
    texts = [name for name in FILES if Path(name).suffix in TEXT_ENDINGS]
    check('codespell', '--ignore-words-list', SPELLING_IGNORED, *texts)


def test_doxygen():
    """The public headers are documented without a warning. Every type has a description; a member may do without."""
    need('doxygen')
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, 'Doxyfile')
        config.write_text((ROOT / 'Doxyfile').read_text() + f'OUTPUT_DIRECTORY = {folder}\nEXTRACT_ALL = NO\nQUIET = YES\n')
        done = subprocess.run(['doxygen', config], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    findings = [line for line in done.stdout.splitlines() if not re.search(r'Member .* is not documented', line)]
    assert not findings and done.returncode == 0
