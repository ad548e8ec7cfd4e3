# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What holds for README.md and docs/: links lead somewhere, and programs, arguments and messages are those of the code."""
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from all_in_focus.files.rig import Optics, load_rig
from file_helpers import run
from tool_helpers import tool

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
LINE_LENGTH = 130


def name_of(path):
    return str(path.relative_to(ROOT))


def split(path):
    """(prose lines with their numbers, code lines) of a page; tables, headings and pictures count as neither."""
    prose, code, fenced = [], [], False
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if line.startswith('```'):
            fenced = not fenced
        elif fenced:
            code.append(line)
        elif not line.startswith(('|', '#', '![')):
            prose.append((number, line))
    return prose, code


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_lines_are_short(page):
    assert not [f'{name_of(page)}:{number}' for number, line in split(page)[0] if len(line) >= LINE_LENGTH]


def anchors(page):
    """As GitHub makes them from headings."""
    headings = re.findall(r'^#+ (.*)$', page.read_text(), re.M)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    text = re.sub(r'^```.*?^```', '', page.read_text(), flags=re.M | re.S)
    for target in re.findall(r'\]\(([^)\s]+)\)', text):
        if '://' in target:
            continue
        path, _, anchor = target.partition('#')
        found = (page.parent / path).resolve() if path else page
        assert found.exists(), f'{name_of(page)}: {target}'
        assert not anchor or anchor in anchors(found), f'{name_of(page)}: {target}'


def test_the_index_names_every_page():
    linked = set(re.findall(r'\(([\w./]+\.md)', (ROOT / 'docs/README.md').read_text()))
    pages = {str(page.relative_to(ROOT / 'docs')) for page in (ROOT / 'docs').rglob('*.md')} - {'README.md'}
    assert linked - {'../README.md', '../CONTRIBUTING.md'} == pages


def programs():
    tools = {path.stem for path in (ROOT / 'src/tools').glob('*.cpp') if 'int main' in path.read_text()}
    cmake = '\n'.join(path.read_text() for path in [ROOT / 'CMakeLists.txt', *(ROOT / 'src').glob('*/CMakeLists.txt')])
    listed = ' '.join(re.findall(r'foreach\((?:node|program) ([\w ]+)\)', cmake)).split()
    nodes = re.findall(r'add_executable\((\w+) \1\.cpp\)', cmake)
    return tools | {*listed, *nodes, *re.findall(r'^(?:  |install\(PROGRAMS )scripts/(\w+)', cmake, re.M)}


def commands(page):
    """Logical lines of the code blocks: continued lines joined, comments and prompts left out."""
    text = re.sub(r'\\\n\s*', ' ', '\n'.join(split(page)[1]))
    return [re.split(r'\s#\s', line)[0] for line in text.splitlines()]


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_programs_and_launch_files_exist(page):
    for line in commands(page):
        for program in re.findall(r'rosrun all_in_focus (\w+)', line):
            assert program in programs(), f'{name_of(page)}: {program}'
        for launch, rest in re.findall(r'roslaunch (?:--\w+ )?all_in_focus (\w+\.launch)(.*)', line):
            args = {arg.get('name') for arg in ET.parse(ROOT / 'launch' / launch).iter('arg')}
            named = set(re.findall(r'\s([a-z]\w*):=', rest))
            assert named <= args, f'{name_of(page)}: {launch} has no {named - args}'


@pytest.mark.parametrize('program', ['check_depth', 'fuse_stack', 'list_stack', 'segment_depth'])
def test_the_reference_names_every_option(program):
    text = run([tool(program), '--help']).stdout
    options = set(re.findall(r'^ +--([a-z-]+)', text, re.M)) - {'help', 'version'}
    page = (ROOT / 'docs/reference.md').read_text()
    synopsis = re.search(rf'^{program} .*?(?=^\w)', page, re.M | re.S)[0]
    assert set(re.findall(r'--([a-z-]+)', synopsis)) == options


def literals():
    """Text of the sources with adjacent string literals joined, so that a message can be found that spans lines."""
    files = [*(ROOT / 'src').rglob('*.[ch]pp'), *(ROOT / 'src').rglob('*.py')]
    text = '\n'.join(path.read_text() for path in files)
    return re.sub(r'(["\'])\s*\n?\s*[fr]?\1', '', text).replace('\\"', '"').replace('{{', '{').replace('}}', '}')


def test_the_messages_of_troubleshooting_are_those_of_the_code():
    text = (ROOT / 'docs/troubleshooting.md').read_text()
    messages = re.findall(r'^\| `([^`]+)` \|', text, re.M)
    assert len(messages) > 20
    code = literals()
    for message in messages:
        for part in filter(None, (part.strip(' "') for part in message.split('...'))):
            assert part in code, f'no message has the words: {part}'


def test_the_example_rig_is_complete():
    rig = load_rig(ROOT / 'config/example_rig')
    assert rig.optics == Optics(24, 4, 0.019)
    assert (rig.depth.width, rig.depth.height, rig.color.width, rig.color.height) == (640, 480, 1920, 1280)


def test_the_tests_that_show_what_is_promised_exist():
    text = (ROOT / 'docs/reliability.md').read_text()
    files = {path.name: path for path in (ROOT / 'test').rglob('*') if path.is_file() and path.suffix != '.pyc'}
    sources = ''.join(path.read_text() for path in files.values() if path.suffix in ('.py', '.cpp'))
    named = re.findall(r'`(\w+\.(?:py|cpp|test))`', text)
    assert len(named) > 20 and not set(named) - set(files)
    for name in re.findall(r'`(test_\w+|[A-Z]\w+)(?:\.\.\.)?`', text):
        assert name in sources, name
    cases = set(re.findall(r'"(\w+)": \("\w+_cases"', (ROOT / 'test/stress/run').read_text()))
    assert cases and set(re.findall(r'stress case `(\w+)`', text)) <= cases
