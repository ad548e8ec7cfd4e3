# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cases for the programs: each takes (case, scene, seconds)."""
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from file_helpers import SCRIPTS, file_limit, run, run_script, script, start
from mutation import mutate_bytes
from tool_helpers import succeeded, tool

PROGRAM_TIMEOUT = 60  # s


# --- files ------------------------------------------------------------------------------------------------------------

def programs(scene, folder):
    """name -> (command, files that it reads); {FOLDER}: copy of the scene that is mutated, {OUT}: an empty folder."""
    scripts, stack, rig = Path(SCRIPTS), ["stack"], ["rig/depth.yaml", "rig/color.yaml", "rig/extrinsics.yaml"]
    inputs = ["--stack", "{FOLDER}/stack", "--focus", "{FOLDER}/focus.yaml", "--depth", "{FOLDER}/depth.png", "--rig",
              "{FOLDER}/rig"]
    files = stack + rig + ["rig/optics.yaml", "focus.yaml", "depth.png"]
    python = [sys.executable]
    return {
        "fuse_stack": ([tool("fuse_stack"), *inputs, "--output", "{OUT}/out.png"], files),
        "segment_depth": ([tool("segment_depth"), "--depth", "{FOLDER}/depth.png", "--optics", "24,4,0.019", "--output",
                           "{OUT}/out.png", "--report", "{OUT}/out.json"], ["depth.png"]),
        "make_bag": (python + [scripts / "make_bag", *inputs, "--output", "{OUT}/out.bag"], files),
        "check_bag": (python + [scripts / "check_bag", "{FOLDER}/scene.bag"], ["scene.bag"]),
        "bag_to_stack": (python + [scripts / "bag_to_stack", "{FOLDER}/scene.bag", "--output", "{OUT}/out"],
                         ["scene.bag"]),
        "check_rig": (python + [scripts / "check_rig", "--rig", "{FOLDER}/rig", "--depth", "{FOLDER}/depth.png", "--color",
                                "{FOLDER}/stack/" + min(path.name for path in (scene.folder / "stack").iterdir()),
                                "--output", "{OUT}/out.png"], rig + ["depth.png", "stack"]),
    }


def complaint_about(done):
    """What is wrong with how a program ended; "" if nothing."""
    lines = [line for line in done.stderr.splitlines() if line.strip() and "warning:" not in line]
    if done.returncode < 0:
        return f"ended by signal {-done.returncode}"
    if "Traceback" in done.stderr:
        return f"traceback: {lines[-1] if lines else ''}"
    if done.returncode > 2:
        return f"exit code {done.returncode}"
    if done.returncode and len(lines) != 1:
        return f"exit code {done.returncode} with {len(lines)} lines: {' | '.join(lines)[:200]}"
    return ""


def fuzz_files(case, scene, seconds):
    """Mutated files to every program: it ends by itself, with exit code 0 to 2 and at most one line of error."""
    original = case.folder / "files"
    shutil.rmtree(str(original), ignore_errors=True)
    shutil.copytree(str(scene.folder), str(original))
    succeeded(run_script("make_bag", "--stack", scene.folder / "stack", "--depth", scene.folder / "depth.png", "--rig",
                         scene.rig, "--output", original / "scene.bag"))
    table, runs, results = programs(scene, original), 0, Counter()
    for name, (command, _) in table.items():  # unchanged files are taken
        done = run_program(command, original)
        if done.returncode not in (0, 1):
            case.fail(f"{name} refuses the unchanged files: {done.stderr.strip()[:300]}")
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(case.failures) < 20:
        name = case.rng.choice(sorted(table))
        command, files = table[name]
        with tempfile.TemporaryDirectory() as temporary:
            copy_of = Path(temporary) / "scene"
            shutil.copytree(str(original), str(copy_of))
            path = copy_of / case.rng.choice(files)
            if path.is_dir():
                path = case.rng.choice(sorted(path.iterdir()))
            path.write_bytes(mutate_bytes(path.read_bytes(), case.rng))
            runs += 1
            try:
                done = run_program(command, copy_of)
                results[name, done.returncode] += 1
                wrong = complaint_about(done)
            except subprocess.TimeoutExpired:
                wrong = f"does not end within {PROGRAM_TIMEOUT} s"
            if wrong:
                kept = case.keep(f"{runs}_{name}_{path.name}", path.read_bytes())
                case.fail(f"{name}, {path.relative_to(copy_of)}: {wrong}; kept in {kept}")
    taken = sum(number for (_, code), number in results.items() if code == 0)
    case.summary = f"{runs} runs, {runs - taken} refusals"
    for (name, code), number in sorted(results.items()):
        print(f"  {name}: {number} times exit code {code}")


def run_program(command, folder):
    with tempfile.TemporaryDirectory() as out:
        command = [str(part).replace("{FOLDER}", str(folder)).replace("{OUT}", out) for part in command]
        return run(command, timeout=PROGRAM_TIMEOUT)


# --- disk -------------------------------------------------------------------------------------------------------------

# Mounts a file system of $1 kB at $2, runs the program, and lists in $3 what it left.
ON_SMALL_DISK = """mount -t tmpfs -o size=$1k none "$2" || exit 99
place=$2; list=$3; shift 3; "$@"; code=$?
find "$place" -type f -printf '%P %s\\n' > "$list"; exit $code"""


def on_small_disk(command, kb, folder):
    """(finished process, {file: size}) of a program whose {OUT} is on a file system of so many kB; None without mounts."""
    place, listing = folder / "disk", folder / "left"
    place.mkdir()
    command = [str(part).replace("{OUT}", str(place)) for part in command]
    unshared = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", ON_SMALL_DISK, "sh", str(kb), str(place)]
    done = run([*unshared, str(listing), *command], timeout=PROGRAM_TIMEOUT)
    if not listing.exists():
        return None
    return done, dict(line.rsplit(" ", 1) for line in listing.read_text().splitlines())


def with_small_files(command, kb, folder):
    """As on_small_disk(), for computers that allow no mount: a limit on the size of each file stands in for the disk."""
    place = folder / "disk"
    place.mkdir(exist_ok=True)
    command = [str(part).replace("{OUT}", str(place)) for part in command]
    done = run(command, timeout=PROGRAM_TIMEOUT, preexec_fn=file_limit(kb), restore_signals=False)
    return done, {str(path.relative_to(place)): path.stat().st_size for path in place.rglob("*") if path.is_file()}


def fill_disk(case, scene, seconds):
    """A disk that gets full at any byte: all outputs are there, or one line tells why not, and none is."""
    bag = case.folder / "disk.bag"
    succeeded(run_script("make_bag", *scene.files, "--output", bag))
    scripts, python = Path(SCRIPTS), sys.executable
    commands = {
        "fuse_stack": [tool("fuse_stack"), *scene.files, "--output", "{OUT}/out.png", "--save-labels", "{OUT}/labels.png",
                       "--save-registered", "{OUT}/depth.png", "--save-weights", "{OUT}/weights.png", "--report", "{OUT}/r.json"],
        "segment_depth": [tool("segment_depth"), "--depth", scene.folder / "depth.png", "--optics", "24,4,0.019", "--output",
                          "{OUT}/out.png", "--report", "{OUT}/out.json"],
        "make_bag": [python, scripts / "make_bag", *scene.files, "--output", "{OUT}/out.bag"],
        "bag_to_stack": [python, scripts / "bag_to_stack", bag, "--output", "{OUT}/out"],
        "make_scene": [python, script("make_scene"), "--scene", "planes", "--size", "160x120", "--frames", 3, "--output",
                       "{OUT}/out"]}
    whole, results, where = {}, Counter(), "on file systems that got full"
    end, turn = time.monotonic() + seconds, 0
    while (time.monotonic() < end or turn < 3 * len(commands)) and len(case.failures) < 10:
        name = sorted(commands)[turn % len(commands)]
        turn += 1
        with tempfile.TemporaryDirectory() as temporary:
            kb = case.rng.randint(1, whole[name][1]) if name in whole else 100000
            found = on_small_disk(commands[name], kb, Path(temporary))
            if found is None:
                where = "with a limit on the size of files: no mount was allowed"
                found = with_small_files(commands[name], kb, Path(temporary))
        done, left = found
        results[done.returncode == 0] += 1
        if name not in whole:
            if done.returncode:
                case.fail(f"{name} on an empty disk: {done.stderr.strip()[:200]}")
                break
            # What it left, and a quarter more: a file system has blocks, and some programs write twice.
            whole[name] = set(left), 5 * sum(map(int, left.values())) // 4096 + 40
            continue
        wrong = complaint_about(done)
        if done.returncode == 0 and set(left) != whole[name][0]:
            wrong = f"exit code 0, but it left {sorted(left)}"
        if done.returncode and left:
            wrong = f"exit code {done.returncode}, but it left {sorted(left)}"
        if wrong:
            case.fail(f"{name}, {kb} kB: {wrong}")
    case.summary = f"{turn} runs {where}, {results[False]} refusals"


# --- signals ----------------------------------------------------------------------------------------------------------

def is_start_of_python(lines):
    """Whether a traceback comes from before the first line of the program: no program can change that."""
    ours = [following.strip() for line, following in zip(lines, lines[1:]) if "/scripts/" in line]
    return lines and lines[-1] == "KeyboardInterrupt" and all(line.startswith("import all_in_focus.early_exit")
                                                              for line in ours)


def send_signals(case, scene, seconds):
    """SIGTERM and SIGINT at a random moment: the program ends soon, says at most one line, leaves no partial file."""
    original = case.folder / "signals"
    shutil.rmtree(str(original), ignore_errors=True)
    shutil.copytree(str(scene.folder), str(original))
    inputs = ["--stack", original / "stack", "--focus", original / "focus.yaml", "--depth", original / "depth.png",
              "--rig", original / "rig"]
    commands = {"fuse_stack": [tool("fuse_stack"), *inputs, "--output"],
                "make_bag": [sys.executable, Path(SCRIPTS) / "make_bag", *inputs, "--output"]}
    runs, early, end, longest = 0, 0, time.monotonic() + seconds, {name: 0.5 for name in commands}
    while time.monotonic() < end and len(case.failures) < 10:
        name, number = case.rng.choice(sorted(commands)), case.rng.choice((signal.SIGINT, signal.SIGTERM))
        output = original / "out" / f"{runs}.png"
        output.parent.mkdir(exist_ok=True)
        runs += 1
        begin = time.monotonic()
        process = start([*commands[name], output], stdout=subprocess.DEVNULL)
        time.sleep(case.rng.uniform(0, longest[name]))
        process.send_signal(number)
        try:
            lines = [line for line in process.communicate(timeout=20)[1].splitlines() if line.strip()]
            if is_start_of_python(lines):
                early += 1
                lines = []
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            case.fail(f"{name} goes on after {number.name}")
            continue
        longest[name] = max(longest[name], min(5.0, time.monotonic() - begin))
        where = f"{name}, {number.name} after {time.monotonic() - begin:.2f} s"
        if len(lines) > 1:
            case.fail(f"{where}: {len(lines)} lines: {lines[-1][:150]}")
        if process.returncode == 0 and not output.exists():
            case.fail(f"{where}: exit code 0 without a result")
        left = [path.name for path in output.parent.iterdir() if path != output]
        if left:
            case.fail(f"{where}: left {', '.join(left)[:150]}")
        shutil.rmtree(str(output.parent))
    case.summary = f"{runs} runs, {early} of them ended before the first line of the program"
