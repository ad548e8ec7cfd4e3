# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What holds for the sources themselves: layers, licence, and one default for each parameter."""
import ast
import os
import re
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path

import pytest

from all_in_focus.files.rig import DEFAULT_OPTICS

ROOT = Path(__file__).resolve().parent.parent
NOT_OURS = {'.git', 'build', 'demo_output', '__pycache__', '.pytest_cache'}

# cfg parameters whose member in the core has another name.
CORE_NAMES = {'dof_rule': 'span'}

# Functions of os.path that pathlib of Python 3.8 does not have: to take `..` out without following links, to find a link that
# leads nowhere, to compare an open file with one on disk, to follow links where one may lead to itself.
OS_PATH_FUNCTIONS = {'abspath', 'lexists', 'realpath', 'samestat'}


def literal_defaults(name, text):
    """Of `type name = literal`; another config's member in the literal's place cannot differ and is not compared."""
    return re.findall(rf'\w[\w:]*\s+{name}\s*=\s*([-\w.:"]+)\s*[;,)]', text)


def files():
    for folder, folders, names in os.walk(ROOT):
        folders[:] = sorted(set(folders) - NOT_OURS)
        yield from (Path(folder) / name for name in sorted(names))


def sources():
    """Programs of every language; scripts may have no suffix."""
    for path in files():
        if path.suffix in {'.cpp', '.hpp', '.h', '.py', '.cfg', '.sh'} or path.read_bytes()[:2] == b'#!':
            yield path


def relative(paths):
    return [str(path.relative_to(ROOT)) for path in paths]


def core_files():
    return [path for folder in ('include', 'src/core') for path in sorted((ROOT / folder).rglob('*.[ch]pp'))]


def test_core_includes_only_std_and_opencv_core_and_imgproc():
    allowed = re.compile(r'<[a-z_0-9]+>|[<"]opencv2/(core|imgproc)(/[\w/]+)?\.(hpp|h)[>"]|"all_in_focus/\w+\.hpp"')
    found = {(str(path.relative_to(ROOT)), name)
             for path in core_files()
             for name in re.findall(r'^\s*#\s*include\s*(\S+)', path.read_text(), re.M)
             if not allowed.fullmatch(name) and not (ROOT / 'src/core' / name.strip('"')).is_file()}
    assert len(core_files()) > 1
    assert not found


def python_imports(path, package):
    """What a Python file imports of our packages, also inside functions: modules of this one, the name of the other. The
    generated messages are no module."""
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: imports by whole names only'
            names = [f'{node.module}.{alias.name}' for alias in node.names]
        for parts in (name.split('.') for name in names):
            if parts[0] in ('all_in_focus', 'all_in_focus_lab') and parts[1:2] not in ([], ['msg'], ['srv'], ['cfg']):
                yield parts[1] if parts[0] == package else parts[0]


def documented_boxes(heading):
    """{its modules: boxes that it uses} of the picture in docs/architecture.md below this heading, in its order."""
    text = (ROOT / 'docs/architecture.md').read_text()
    picture = re.search(rf'^### {re.escape(heading)}.*?```mermaid\nflowchart LR\n(.*?)^```', text, re.M | re.S)[1]
    boxes = re.findall(r'^  (\w+)\["<b>([^<]+)</b><br>[^"]+"\]$', picture, re.M)
    arrows = {of: to.split(' & ') for of, to in re.findall(r'^  (\w+) --> (.*)$', picture, re.M)}
    modules = {box: tuple(names.split(', ')) for box, names in boxes}
    assert len(boxes) <= 12 and len(boxes) + len(arrows) == len(picture.splitlines()), f'{heading}: one sentence a box'
    return {modules[box]: [modules[used] for used in arrows.get(box, [])] for box, _ in boxes}


def compare_modules(heading, found):
    """found: {module: {module that it uses: a file that does}}"""
    above, documented = set(), documented_boxes(heading)
    box_of = {module: box for box in documented for module in box}
    assert set(box_of) == set(found)
    for box, uses in documented.items():
        assert set(uses) <= above, f'{box} uses what does not stand above it'
        assert set(uses) == {box_of[used] for module in box for used in found[module]}, f'{box}: {[found[m] for m in box]}'
        above.add(box)


def python_modules(package):
    """{module: {module that it uses: a file that does}}. Seen from outside, a package is one module."""
    folder, found = ROOT / 'src' / package, {}
    for path in folder.rglob('*.py'):
        module = path.relative_to(folder).parts[0].replace('.py', '')
        found.setdefault(module, {}).update({used: path for used in python_imports(path, package) if used != module})
    assert not found.pop('__init__')
    return found


def test_the_picture_of_the_laboratory_is_true():
    compare_modules('Laboratory', {'all_in_focus': {}, **python_modules('all_in_focus_lab')})


def test_programs_of_the_runtime_do_without_the_laboratory():
    programs = [path for path in (ROOT / 'scripts').iterdir() if path.is_file() and b'python' in path.read_bytes()[:40]]
    assert len(programs) > 10
    assert not [path for path in programs if 'all_in_focus_lab' in python_imports(path, 'all_in_focus')]


def cpp_modules():
    """{file: module} of the C++ files of src/ and include/. A public header belongs to the module of its source file."""
    modules = {path: str(path.parent.relative_to(ROOT / 'src')) for path in (ROOT / 'src').rglob('*.[ch]pp')}
    of_source = {path.stem: module for path, module in modules.items() if path.suffix == '.cpp' and module.startswith('core')}
    modules.update({path: of_source.get(path.stem, 'core') for path in (ROOT / 'include').rglob('*.hpp')})
    return modules


def included(path, modules):
    """Files of ours that a file includes: with quotes, below include/, beside it, or by their path from a folder of src/."""
    for name in re.findall(r'^\s*#\s*include\s*"([^"]+)"', path.read_text(), re.M):
        folders = [ROOT / 'include', path.parent, *(ROOT / 'src' / module for module in sorted(set(modules.values())))]
        found = [(folder / name).resolve() for folder in folders if (folder / name).resolve() in modules]
        assert found, f'{path.relative_to(ROOT)}: where is "{name}"?'
        yield found[0]


def test_the_pictures_of_the_runtime_are_true():
    """Seen from outside, `core` is the public headers. There is no box for the laboratory: nothing here uses it."""
    modules = cpp_modules()
    core, around = ({module: {} for module in modules.values() if module.startswith('core') == inside}
                    for inside in (True, False))
    for path, module in modules.items():
        for header in included(path, modules):
            used = modules[header]
            if not module.startswith('core') and used.startswith('core'):
                used = 'core' if (ROOT / 'include') in header.parents else f'private header {header.name} of {used}'
            if used != module:
                (core if module in core else around)[module][used] = path
    compare_modules('Inside the core', core)
    compare_modules('Runtime', {'core': {}, **around, **python_modules('all_in_focus')})


def test_tools_know_no_ros_and_only_kinect_knows_openni():
    ros = re.compile(r'<(ros|nodelet|image_transport|cv_bridge|dynamic_reconfigure|tf2_ros|\w+_msgs|\w+_srvs|all_in_focus)/')
    for path, module in cpp_modules().items():
        text = path.read_text()
        assert not (module == 'tools' and ros.search(text)), path
        assert module == 'kinect' or not re.search(r'<(OpenNI|Oni)\w*\.h>', text), path


def test_no_two_python_modules_share_a_name():
    """One name, one subject."""
    names = [path.stem for path in (ROOT / 'src').rglob('*.py') if path.stem != '__init__']
    assert not {name for name in names if names.count(name) > 1}


def is_text(node):
    """Whether an expression is a string by its looks: a literal, or literals joined by +."""
    return (isinstance(node, ast.JoinedStr) or isinstance(node, ast.Constant) and isinstance(node.value, str)
            or isinstance(node, ast.BinOp) and (is_text(node.left) or is_text(node.right)))


@lru_cache(maxsize=None)
def python_nodes():
    """(path:line, node) of the syntax trees of all Python sources."""
    python = [path for path in sources() if path.suffix in {'.py', '.cfg'} or b'python' in path.read_bytes()[:40]]
    assert len(python) > 150
    return [(f'{path.relative_to(ROOT)}:{getattr(node, "lineno", 0)}', node)
            for path in python for node in ast.walk(ast.parse(path.read_text()))]


def test_strings_are_formatted_as_f_strings():
    """Not by %, which counts its values only when it runs; by format() only templates that come in a variable."""
    assert not [place for place, node in python_nodes()
                if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mod) and is_text(node.left)
                or isinstance(node, ast.Call) and getattr(node.func, 'attr', '') == 'format'
                and (is_text(node.func.value) or not getattr(node.func.value, 'id', 'a')[0].islower())]


def test_paths_are_those_of_pathlib():
    used = [(place, node.attr) for place, node in python_nodes()
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == 'path'
            and isinstance(node.value.value, ast.Name) and node.value.value.id == 'os']
    assert {name for _, name in used} >= OS_PATH_FUNCTIONS, 'a name that is not needed any more'
    assert not [place for place, name in used if name not in OS_PATH_FUNCTIONS]


def test_every_source_names_author_and_licence():
    lines = ['SPDX-FileCopyrightText: all_in_focus contributors', 'SPDX-License-Identifier: BSD-3-Clause']
    without = [path for path in sources()
               if not all(line in '\n'.join(path.read_text().split('\n')[:3]) for line in lines)]
    assert not relative(without)


def test_no_two_rostests_write_the_same_result_file():
    names = [test.get('test-name') for path in (ROOT / 'test').rglob('*.test') for test in ET.parse(path).iter('test')]
    assert len(names) == len(set(names))


def cfg_defaults():
    """(file, parameter, default) of every gen.add(name, type, level, description, default, ...)."""
    for path in sorted((ROOT / 'cfg').glob('*.cfg')):
        for call in ast.walk(ast.parse(path.read_text())):
            if isinstance(call, ast.Call) and getattr(call.func, 'attr', '') == 'add':
                yield path.name, ast.literal_eval(call.args[0]), ast.literal_eval(call.args[4])


def value(text):
    """A literal of C++, XML or Markdown as a Python value: 4.0f, true, `24`, DofSpan::kPaper."""
    text = text.strip().strip('`"')
    if text.lower() in ('true', 'false'):
        return text.lower() == 'true'
    try:
        return float(re.sub(r'(?<=[\d.])f$', '', text))
    except ValueError:
        return re.sub(r'^\w+::k(\w+)$', lambda match: match[1].lower(), text)


def same(one, other):
    return type(one) is type(other) and one == other


@pytest.mark.parametrize('file, name, default', cfg_defaults())
def test_defaults_agree(file, name, default):
    """cfg, core, launch, config, docs/reference.md."""
    default = float(default) if type(default) is int else default
    for path in sorted((ROOT / 'include').rglob('*.hpp')):
        member = CORE_NAMES.get(name, name)
        header = re.sub(r'^struct \w+Result\b[^{;]*\{.*?^\};', '', path.read_text(), flags=re.M | re.S)  # no parameters there
        constants = dict(re.findall(r'constexpr \w+ (k\w+) = ([^;]+);', header))
        for text in literal_defaults(member, header):
            assert same(value(constants.get(text, text)), default), f'{path.name}: {member} = {text}'
    for path in sorted((ROOT / 'launch').glob('*.launch')):
        for arg in ET.parse(path).iter('arg'):
            text = arg.get('default')
            if arg.get('name') == name and text and '$(' not in text:  # empty: the node's own default
                assert same(value(text), default), f'{path.name}: {name} default {text}'
    for path in sorted((ROOT / 'config').glob('*.yaml')):
        for text in re.findall(rf'^\s*{name}:\s*([^\s#]+)', path.read_text(), re.M):
            assert same(value(text), default), f'{path.name}: {name}: {text}'
    assert same(getattr(DEFAULT_OPTICS, name, default), default), 'files/rig.py'
    rows = re.findall(rf'^\|\s*`{name}`\s*\|(.*)\|\s*$', (ROOT / 'docs/reference.md').read_text(), re.M)
    assert rows, f'docs/reference.md: no row for {name}'
    for row in rows:
        assert any(same(value(cell), default) for cell in row.split('|')), f'docs/reference.md: {name} |{row}|'


def test_optics_and_region_size_have_their_default_in_the_core():
    text = '\n'.join(path.read_text() for path in (ROOT / 'include').rglob('*.hpp'))
    parameters = {CORE_NAMES.get(name, name) for _, name, _ in cfg_defaults()}
    members = {name for name in parameters if literal_defaults(name, text)}
    assert members >= {'focal_length_mm', 'aperture', 'circle_of_confusion_mm', 'span', 'min_region_size'}
