"""A stage for tests of the rviz displays: a ROS master, a virtual screen, rviz with software rendering, pictures of it.

Everything runs on free ports and is ended with the stage. Nothing here needs a graphics card or a person.
"""
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time

import numpy

# exit code that ctest takes for "skipped"
SKIPPED = 77
NEEDED = ["Xvfb", "rviz", "rosmaster", "import", "xdotool", "xwininfo"]


def missing():
    """Programs that the stage needs and that are not here."""
    return [name for name in NEEDED if shutil.which(name) is None]


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def config(displays, view, fixed_frame="tissue", background="0; 0; 0", tools="", rate=30):
    """An rviz configuration without panels: displays and tools are YAML blocks, view a dictionary."""
    def indent(text, by):
        return "".join(" " * by + line + "\n" for line in text.strip("\n").splitlines())
    view_text = "".join("      %s: %s\n" % item for item in view.items())
    tool_text = "    - Class: rviz/Interact\n      Hide Inactive Objects: false\n" + indent(tools, 4)
    return ("Panels: []\nVisualization Manager:\n  Class: \"\"\n  Displays:\n" + indent(displays, 4) +
            "  Enabled: true\n  Global Options:\n    Background Color: %s\n    Default Light: true\n" % background +
            "    Fixed Frame: %s\n    Frame Rate: %d\n  Name: root\n  Tools:\n" % (fixed_frame, rate) + tool_text +
            "  Value: true\n  Views:\n    Current:\n" + view_text + "    Saved: ~\n"
            "Window Geometry:\n  Hide Left Dock: true\n  Hide Right Dock: true\n  Width: %d\n  Height: %d\n  X: 0\n  Y: 0\n")


def magenta_centres(picture):
    """Centres (x, y) in pixels of the magenta patches, from the bottom to the top, from left to right."""
    red, green, blue = (picture[:, :, c].astype(int) for c in range(3))
    groups = []
    for at in numpy.argwhere((red > 80) & (abs(red - blue) < 20) & (green < red // 3)):
        for group in groups:
            if abs(group[0] - at).max() < 25:
                group.append(at)
                break
        else:
            groups.append([at])
    centres = [numpy.mean(group, axis=0)[::-1] for group in groups if len(group) > 20]
    return sorted(centres, key=lambda p: (round(-p[1] / 50), p[0]))


class Map:
    """From metres of a stage seen from above to pixels, by three magenta markers: left and right below, left above."""

    def __init__(self, places, picture):
        self.matrix = numpy.linalg.solve(numpy.column_stack([places, numpy.ones(3)]), numpy.array(magenta_centres(picture)))
        self.scale = abs(self.matrix[0, 0])  # pixels a metre

    def pixel(self, point):
        return numpy.array([point[0], point[1], 1]) @ self.matrix

    def place(self, pixel):
        return (numpy.asarray(pixel) - self.matrix[2]) @ numpy.linalg.inv(self.matrix[:2])


class Stage:
    """`with Stage(config_text) as stage:`. ROS nodes of this process may start inside only."""

    def __init__(self, configuration, width=480, height=400, plugin_path=None):
        self.configuration = configuration % (width, height)
        self.width, self.height = width, height
        self.processes = []
        self.folder = tempfile.mkdtemp(prefix="pliant_rviz_")
        self.plugin_path = plugin_path

    def __enter__(self):
        try:
            self._start()
        except Exception:
            self.__exit__(None, None, None)
            raise
        return self

    def _start(self):
        port = free_port()
        os.environ.update(ROS_MASTER_URI="http://127.0.0.1:%d" % port, ROS_IP="127.0.0.1", ROS_LOG_DIR=self.folder)
        os.environ.pop("ROS_HOSTNAME", None)
        self.start(["rosmaster", "--core", "-p", str(port)], "master")
        for _ in range(200):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        # the server picks a free display and tells its number
        reader, writer = os.pipe()
        self.start(["Xvfb", "-displayfd", str(writer), "-screen", "0", "%dx%dx24" % (self.width, self.height), "-nolisten", "tcp"],
                  "screen", pass_fds=[writer])
        os.close(writer)
        with os.fdopen(reader) as answer:
            self.display = ":" + answer.readline().strip()
        if self.display == ":":
            raise RuntimeError("no virtual screen: " + self.log("screen"))
        os.environ["DISPLAY"] = self.display
        runtime = os.path.join(self.folder, "runtime")
        os.mkdir(runtime, 0o700)
        os.environ.update(LIBGL_ALWAYS_SOFTWARE="1", QT_X11_NO_MITSHM="1", XDG_RUNTIME_DIR=runtime,
                          HOME=self.folder, NO_AT_BRIDGE="1")
        path = os.path.join(self.folder, "test.rviz")
        with open(path, "w") as out:
            out.write(self.configuration)
        self.rviz = self.start(["rviz", "-d", path, "--disable-anti-aliasing"], "rviz")

    def start(self, command, name, pass_fds=()):
        out = open(os.path.join(self.folder, name + ".log"), "wb")
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, start_new_session=True, pass_fds=pass_fds)
        out.close()
        self.processes.append(process)
        return process

    def log(self, name):
        with open(os.path.join(self.folder, name + ".log"), errors="replace") as text:
            return text.read()

    def alive(self):
        return self.rviz.poll() is None

    def window(self):
        """Window of the 3-D view: (x, y, width, height) on the screen; None while it is not there."""
        tree = subprocess.run(["xwininfo", "-root", "-tree"], capture_output=True, text=True).stdout
        best = None
        for line in tree.splitlines():
            parts = line.split()
            if "rviz" not in line or len(parts) < 2:
                continue
            size, corner = parts[-2], parts[-1]
            try:
                width, rest = size.split("x")
                height = rest.split("+")[0]
                _, x, y = corner.split("+")
            except ValueError:
                continue
            if int(width) > 100 and int(height) > 100:
                best = int(x), int(y), int(width), int(height)
        return best

    def picture(self, path=None):
        """The screen as an array (rows, columns, 3) of 0..255."""
        path = path or os.path.join(self.folder, "picture.ppm")
        raw = subprocess.run(["import", "-window", "root", "-depth", "8", "rgb:-"], capture_output=True, timeout=60).stdout
        image = numpy.frombuffer(raw, numpy.uint8).reshape(self.height, self.width, 3)
        if path.endswith(".png"):
            subprocess.run(["convert", "-size", "%dx%d" % (self.width, self.height), "-depth", "8", "rgb:-", path], input=raw,
                           timeout=60)
        return image

    def wait_for(self, check, seconds=30, what="the picture"):
        """Take pictures until check(picture) is true; the last picture either way is in self.last."""
        end = time.time() + seconds
        while time.time() < end:
            if not self.alive():
                raise RuntimeError("rviz died: " + self.log("rviz")[-2000:])
            self.last = self.picture()
            if check(self.last):
                return self.last
            time.sleep(0.2)
        raise AssertionError("waited %g s in vain for %s\n%s" % (seconds, what, self.log("rviz")[-1500:]))

    def mouse(self, *command):
        subprocess.run(["xdotool"] + [str(part) for part in command], check=True, timeout=30)

    def __exit__(self, *_):
        for process in reversed(self.processes):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)
