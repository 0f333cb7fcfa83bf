"""Set up `.venv`: locked requirements, the packages built into it, and the `jammkle` command.

With `--extras` all requirements, else those of the demo. Standard library only, since it runs before anything is
installed. What is done already is skipped: the requirements while the lock file is the same, the build while nothing
that is built has changed.
"""

import hashlib
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VENV = ROOT / ".venv"
LOCK, EXTRAS_LOCK = ROOT / "requirements-demo.lock", ROOT / "requirements.lock"
PACKAGES = (
    "jammkle_msgs",
    "jammkle_common",
    "jammkle_driver",
    "jammkle_controller",
    "jammkle_sim",
    "jammkle_gap",
    "jammkle_view",
    "jammkle_bringup",
)
IMPORTED = ("jammkle_sim.node", "jammkle_driver.node", "jammkle_controller.node", "jammkle_bringup.recorder")
IMPORTED += ("jammkle_bringup.demo", "jammkle_bringup.core.picture", "jammkle_gap", "jammkle_gap.landing")
IMPORTED += ("jammkle_bringup.channels", "jammkle_common.command.main")
"""What the demo, a first session and the command itself import."""
OLDEST_PYTHON = (3, 10)
NEWEST_PYTHON = (3, 13)
COMPILERS = ("c++", "g++", "clang++")


class SetUpError(Exception):
    """Why the set-up cannot go on, in one line."""


def check_machine():
    """Raise SetUpError if this machine cannot run the project."""
    version = sys.version_info[:2]
    if not OLDEST_PYTHON <= version <= NEWEST_PYTHON:
        raise SetUpError(
            "Python %d.%d is not supported: use 3.10 to 3.13, for example `make PYTHON=python3.12 demo`." % version
        )
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise SetUpError(
            "The ROS 2 wheels are built for Linux on x86_64, and this is %s on %s: use a sourced ROS 2 Jazzy instead "
            "(docs/start.md, 'In a sourced ROS 2 Jazzy')." % (platform.system(), platform.machine())
        )
    if not importlib.util.find_spec("ensurepip"):
        raise SetUpError("This Python has no `ensurepip`: install it, for example `apt install python3-venv`.")
    compiler = os.environ.get("CXX")
    if not any(shutil.which(name) for name in ((compiler,) if compiler else COMPILERS)):
        raise SetUpError(
            "No C++ compiler found (%s): the interfaces are compiled, so install one, for example "
            "`apt install g++`." % (compiler or ", ".join(COMPILERS))
        )
    if not shutil.which("make"):
        raise SetUpError("No `make` found: the interfaces are compiled, so install it, for example `apt install make`.")


def fingerprint(paths):
    """Return a hash over this Python, the checkout's place, and the names and contents of `paths`."""
    digest = hashlib.sha256(("%s %s" % (sys.version, ROOT)).encode())
    for path in sorted(paths):
        digest.update(str(path.relative_to(ROOT)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def built_files():
    """Files whose change calls for a new build: all of jammkle_msgs, and what describes or is copied from the rest.

    Python modules of the ament_python packages are linked, not copied, so editing them needs no build.
    """
    files = [Path(__file__).resolve(), LOCK]
    files += (path for path in (ROOT / PACKAGES[0]).rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    for package in PACKAGES[1:]:
        folder = ROOT / package
        files += [folder / name for name in ("package.xml", "setup.py", "setup.cfg")]
        for shared in ("launch", "config"):
            files += (path for path in (folder / shared).glob("*") if path.is_file())
    return files


def run(arguments, log, environment=None):
    """Run a command with its output in `log`; raise SetUpError with the log's end if it fails."""
    with log.open("w") as output:
        code = subprocess.call(arguments, cwd=str(ROOT), env=environment, stdout=output, stderr=subprocess.STDOUT)
    if code:
        tail = "\n".join(log.read_text(errors="replace").splitlines()[-25:])
        raise SetUpError("%s\n`%s` ended with %d; the whole log is %s" % (tail, arguments[0], code, log))


def clean_environment():
    """Return this process's environment without what another ROS or virtual environment has put into it."""
    dropped = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH")
    return {
        key: value
        for key, value in os.environ.items()
        if key not in dropped and not key.startswith(("AMENT_", "COLCON_", "CMAKE_PREFIX", "ROS_"))
    }


def install_requirements():
    """Make the virtual environment and install the lock file into it."""
    if VENV.exists() and not (VENV / "venv.log").exists():
        raise SetUpError(".venv is there and was not made by this set-up: move it away or delete it, then try again.")
    shutil.rmtree(str(VENV), ignore_errors=True)
    run([sys.executable, "-m", "venv", str(VENV)], ROOT / ".set_up.log", clean_environment())
    (ROOT / ".set_up.log").rename(VENV / "venv.log")
    # Of all that is installed the demo imports a small part: see write_bytecode.
    install(LOCK, "--no-compile")
    point_exports_here()


def install(lock, *options):
    """Install a lock file into the environment."""
    pip = [str(VENV / "bin" / "python"), "-m", "pip", "--disable-pip-version-check", "install", "--no-input"]
    # The lock names all there is. Left to look for dependencies itself, pip takes a newer release of what has an extra,
    # such as coverage[toml], than the lock has, and then refuses it for having no hash.
    pip += ["--no-deps", "--require-hashes", *options, "-r", str(lock)]
    run(pip, VENV / "requirements.log", clean_environment())


def install_build_tool():
    """Install cmake as locked, which is needed while the interfaces are built, and large."""
    text = EXTRAS_LOCK.read_text()
    begin = text.index("\ncmake==") + 1
    end = next(place for place in range(begin + 1, len(text)) if text[place - 1] == "\n" and not text[place].isspace())
    alone = VENV / "cmake.lock"
    alone.write_text(text[begin:end])
    install(alone, "--no-compile")


def remove_build_tool():
    """Remove cmake again."""
    pip = [str(VENV / "bin" / "python"), "-m", "pip", "--disable-pip-version-check", "uninstall", "--yes", "cmake"]
    run(pip, VENV / "requirements.log", clean_environment())


def point_exports_here():
    """Rewrite the paths of the machine that built the wheels, in the CMake files they export, to this environment's."""
    query = "import sysconfig, numpy; print(sysconfig.get_path('include')); print(numpy.get_include())"
    answer = subprocess.check_output([str(VENV / "bin" / "python"), "-c", query], env=clean_environment())
    python_include, numpy_include = answer.decode().split("\n")[:2]
    tag = "cp%d%d" % sys.version_info[:2]
    built_in = "/opt/python/%s-%s" % (tag, tag)
    name = "python%d.%d" % sys.version_info[:2]
    rewrites = {
        "%s/lib/%s/site-packages/numpy/_core/include" % (built_in, name): numpy_include,
        "%s/lib/%s/site-packages/numpy/core/include" % (built_in, name): numpy_include,
        "%s/include/%s" % (built_in, name): python_include,
    }
    for export in (VENV / "share").glob("*/cmake/*.cmake"):
        text = export.read_text()
        changed = text
        for old, new in rewrites.items():
            changed = changed.replace(old, new)
        if changed != text:
            export.write_text(changed)


def build():
    """Build the packages with colcon into the environment itself, and link the command into its bin."""
    had_cmake = (VENV / "bin" / "cmake").exists()
    if not had_cmake:
        install_build_tool()
    environment = clean_environment()
    environment["PATH"] = "%s%s%s" % (VENV / "bin", os.pathsep, environment["PATH"])
    environment["VIRTUAL_ENV"] = str(VENV)
    environment["CMAKE_PREFIX_PATH"] = environment["AMENT_PREFIX_PATH"] = str(VENV)
    python = VENV / "bin" / "python"
    colcon = [str(VENV / "bin" / "colcon"), "--log-base", str(VENV / "colcon" / "log"), "build"]
    colcon += ["--merge-install", "--symlink-install", "--install-base", str(VENV)]
    colcon += ["--build-base", str(VENV / "colcon" / "build"), "--paths", *(str(ROOT / name) for name in PACKAGES)]
    colcon += ["--cmake-args", "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF"]
    colcon += ["-DPython3_EXECUTABLE=%s" % python, "-DPython3_FIND_VIRTUALENV=ONLY", "-DPYTHON_EXECUTABLE=%s" % python]
    run(colcon, VENV / "build.log", environment)
    if not had_cmake:
        remove_build_tool()
    # colcon makes its linked packages importable by a setup script to be sourced; a .pth file does without one.
    site_packages = VENV / "lib" / ("python%d.%d" % sys.version_info[:2]) / "site-packages"
    linked = [str(VENV / "colcon" / "build" / name) for name in PACKAGES[1:]]
    (site_packages / "jammkle.pth").write_text("\n".join(linked) + "\n")
    command = VENV / "bin" / "jammkle"
    if command.is_symlink() or command.exists():
        command.unlink()
    command.symlink_to(Path("..") / "lib" / "jammkle_bringup" / "jammkle")
    write_bytecode()


def write_bytecode():
    """Import what the demo runs: Python writes its bytecode, also where it is set to write none while it runs."""
    environment = clean_environment()
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    python = str(VENV / "bin" / "python")
    lines = "import %s; jammkle_common.command.main.main(['--help'])" % ", ".join(IMPORTED)
    run([python, "-c", lines], VENV / "bytecode.log", environment)


def step(name, stamp, mark, action):
    """Run `action` unless `stamp` holds `mark`, and say what is done and how long it took."""
    if stamp.exists() and stamp.read_text() == mark:
        return
    start_s = time.monotonic()
    sys.stdout.write("set-up: %s ... " % name)
    sys.stdout.flush()
    action()
    stamp.write_text(mark)
    sys.stdout.write("%.0f s\n" % (time.monotonic() - start_s))


def main():
    """Set up what is missing."""
    try:
        check_machine()
        step("requirements", VENV / ".requirements", fingerprint([LOCK]), install_requirements)
        step("build", VENV / ".built", fingerprint(built_files()), build)
        if "--extras" in sys.argv[1:]:
            step("extras", VENV / ".extras", fingerprint([EXTRAS_LOCK]), lambda: install(EXTRAS_LOCK))
    except SetUpError as error:
        sys.stderr.write("\nset-up: %s\n" % error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
