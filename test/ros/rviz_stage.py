"""A stage for tests of the rviz displays: a ROS master, a virtual screen, rviz with software rendering, and
screenshots.

All processes run on free ports and end with the stage, or with this process. The tests need no graphics card and no
user.
"""
import atexit
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

import numpy

# exit code that ctest treats as "skipped"
SKIPPED = 77
NEEDED = ["Xvfb", "rviz", "rosmaster", "xdotool", "xwininfo"]


def missing():
    """Return the missing programs of the stage."""
    return [name for name in NEEDED if shutil.which(name) is None]


def program(name):
    """Return the path of a program of the package, as roslaunch finds it. rosrun ignores a build folder inside the
    source tree."""
    import roslib.packages
    found = roslib.packages.find_node("pliant", name)
    if not found:
        raise RuntimeError("the package pliant has no program %s: is the setup.bash of its build sourced?" % name)
    return found[0]


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def config(displays, view, fixed_frame="tissue", background="0; 0; 0", tools="", rate=30):
    """Return an rviz configuration without panels. displays and tools are YAML blocks, view is a dictionary. The
    first tool is active."""
    def indent(text, by):
        return "".join(" " * by + line + "\n" for line in text.strip("\n").splitlines())
    view_text = "".join("      %s: %s\n" % item for item in view.items())
    tool_text = indent(tools, 4) + "    - Class: rviz/Interact\n      Hide Inactive Objects: false\n"
    return ("Panels: []\nVisualization Manager:\n  Class: \"\"\n  Displays:\n" + indent(displays, 4) +
            "  Enabled: true\n  Global Options:\n    Background Color: %s\n    Default Light: true\n" % background +
            "    Fixed Frame: %s\n    Frame Rate: %d\n  Name: root\n  Tools:\n" % (fixed_frame, rate) + tool_text +
            "  Value: true\n  Views:\n    Current:\n" + view_text + "    Saved: ~\n"
            "Window Geometry:\n  Hide Left Dock: true\n  Hide Right Dock: true\n  Width: %d\n  Height: %d\n  X: 0\n"
            "  Y: 0\n")


def magenta_centres(picture):
    """Return the centres (x, y) [pixels] of the magenta patches, from the bottom to the top, from left to right."""
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
    """Map from metres of a stage, seen from above, to pixels. Its three magenta markers are at the lower left, lower
    right and upper left."""

    def __init__(self, places, picture):
        self.matrix = numpy.linalg.solve(numpy.column_stack([places, numpy.ones(3)]),
                                         numpy.array(magenta_centres(picture)))
        self.scale = abs(self.matrix[0, 0])  # pixels per metre

    def pixel(self, point):
        return numpy.array([point[0], point[1], 1]) @ self.matrix

    def place(self, pixel):
        return (numpy.asarray(pixel) - self.matrix[2]) @ numpy.linalg.inv(self.matrix[:2])


class Stage:
    """`with Stage(config_text) as stage:`. Start ROS nodes of this process only inside. tells_rows: enables rows()."""

    def __init__(self, configuration, width=480, height=400, plugin_path=None, tells_rows=False):
        self.configuration = configuration % (width, height)
        self.width, self.height = width, height
        self.processes = {}
        self.folder = tempfile.mkdtemp(prefix="pliant_rviz_")
        self.plugin_path = plugin_path
        self.tells_rows = tells_rows

    def __enter__(self):
        # also when a test fails before it has begun, or is terminated after a timeout
        atexit.register(self.close)
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        self._start()
        return self

    def __exit__(self, *_):
        self.close()

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
        # the server chooses a free display and prints its number
        reader, writer = os.pipe()
        self.start(["Xvfb", "-displayfd", str(writer), "-screen", "0", "%dx%dx24" % (self.width, self.height),
                    "-nolisten", "tcp",
                    "-fbdir", self.folder], "screen", pass_fds=[writer])
        os.close(writer)
        with os.fdopen(reader) as answer:
            self.display = ":" + answer.readline().strip()
        if self.display == ":":
            raise RuntimeError("no virtual screen\n" + self.logs())
        self._map_screen(os.path.join(self.folder, "Xvfb_screen0"))
        os.environ["DISPLAY"] = self.display
        runtime = os.path.join(self.folder, "runtime")
        os.mkdir(runtime, 0o700)
        os.environ.update(LIBGL_ALWAYS_SOFTWARE="1", QT_X11_NO_MITSHM="1", XDG_RUNTIME_DIR=runtime,
                          HOME=self.folder, NO_AT_BRIDGE="1")
        path = os.path.join(self.folder, "test.rviz")
        with open(path, "w") as out:
            out.write(self.configuration)
        rviz = [program("rviz_rows"), os.path.join(self.folder, "rows")] if self.tells_rows else ["rviz"]
        self.start(rviz + ["-d", path, "--disable-anti-aliasing"], "rviz")

    def start(self, command, name, pass_fds=()):
        out = open(os.path.join(self.folder, name + ".log"), "wb")
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, start_new_session=True,
                                   pass_fds=pass_fds)
        out.close()
        self.processes[name] = process

    def logs(self):
        """Return the last output of all processes."""
        text = ""
        for name in self.processes:
            with open(os.path.join(self.folder, name + ".log"), errors="replace") as log:
                text += "--- %s\n%s\n" % (name, log.read()[-1500:])
        return text

    def check_alive(self):
        """Raise an error with the logs if a process of the stage has ended."""
        for name, process in self.processes.items():
            if process.poll() is not None:
                raise RuntimeError("%s ended with code %d\n%s" % (name, process.returncode, self.logs()))

    def window(self):
        """Wait for the 3-D view's window. Return (x, y, width, height) on the screen. rviz creates a new window for
        each configuration."""
        return self.wait(self._look_for_window, what="rviz's 3-D view")

    def _look_for_window(self):
        """Return the window as window() does, or None without a window."""
        tree = subprocess.run(["xwininfo", "-root", "-tree"], capture_output=True, text=True)
        if tree.returncode != 0:  # a window disappeared during the query
            return None
        best = None
        for line in tree.stdout.splitlines():
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

    def _map_screen(self, path):
        """Map the server's memory, a file in xwd format: 32-bit header numbers, 12-byte colour entries, then blue,
        green, red, unused."""
        numbers = numpy.fromfile(path, ">u4", 25)
        line, offset = int(numbers[12]), int(numbers[0] + 12 * numbers[19])
        pixels = numpy.memmap(path, numpy.uint8, "r", offset, (self.height, line))
        self.pixels = pixels[:, :4 * self.width].reshape(self.height, self.width, 4)[:, :, 2::-1]

    def picture(self, path=None):
        """Return the screen as an array (rows, columns, 3) of 0..255. path: also write it to this file."""
        image = numpy.array(self.pixels)
        if path:
            subprocess.run(["convert", "-size", "%dx%d" % (self.width, self.height), "-depth", "8", "rgb:-", path],
                           input=image.tobytes(), timeout=60, check=True)
        return image

    def wait(self, check, seconds=60, what="what was asked for"):
        """Wait until check() returns true. Return its result."""
        end = time.time() + seconds
        while True:
            self.check_alive()
            answer = check()
            if answer:
                return answer
            if time.time() > end:
                raise AssertionError("waited %g s in vain for %s\n%s" % (seconds, what, self.logs()))
            time.sleep(0.05)

    def wait_for(self, check, seconds=60, what="the picture"):
        """Take pictures until check(picture) is true. Return this picture."""
        def look():
            self.last = self.picture()
            return check(self.last)
        self.wait(look, seconds, what)
        return self.last

    def agrees(self, check, seconds=60):
        """Take pictures until check(picture) raises no error. Raise the last error after the time limit."""
        def passes(picture):
            try:
                check(picture)
            except AssertionError as error:
                self.disagreement = error
                return False
            return True
        self.disagreement = None
        try:
            self.wait_for(passes, seconds)
        except AssertionError:
            raise self.disagreement

    def _file(self, service, path):
        """Call one of rviz's configuration services (rviz/SendFilePath, whose Python module may not be installed)."""
        import rosservice
        import rospy
        import std_msgs.msg
        kind = type("SendFilePath", (), dict(_type="rviz/SendFilePath", _md5sum="*", _request_class=std_msgs.msg.String,
                                             _response_class=std_msgs.msg.Bool))
        name = self.wait(lambda: next((each for each in rosservice.get_service_list() if each.endswith(service)), None),
                         what="rviz's service " + service)
        if not rospy.ServiceProxy(name, kind)(path).data:
            raise RuntimeError("rviz refused " + path)

    def load(self, configuration):
        """Load another configuration into the same rviz."""
        path = os.path.join(self.folder, "next.rviz")
        with open(path, "w") as out:
            out.write(configuration % (self.width, self.height))
        self._file("/load_config_discarding_changes", path)

    def saved(self):
        """Return rviz's current configuration, with the settings of views, displays and tools."""
        import yaml
        path = os.path.join(self.folder, "saved.rviz")
        self._file("/save_config", path)
        with open(path) as text:
            return yaml.safe_load(text)["Visualization Manager"]

    def rows(self):
        """Return the visible rows of the panels by path: the centre of the value (x, y) on the screen, and its text."""
        with open(os.path.join(self.folder, "rows")) as text:
            lines = [line.rstrip("\n").split("\t") for line in text]
        return {path: ((int(x), int(y)), value) for path, x, y, value in lines}

    def still(self, seconds=60):
        """Return a picture after the screen has not changed for a second."""
        seen = []

        def stays(picture):
            now = time.time()
            if not seen or not numpy.array_equal(self.view(seen[0]), self.view(picture)):
                seen[:] = picture, now
            return now - seen[1] > 1
        return self.wait_for(stays, seconds, "a picture that stays")

    def view(self, picture):
        """Return the picture without the bar with the frame rate."""
        x, y, width, height = self.window()
        return picture[y:y + height, x:x + width]

    def mouse(self, *command):
        subprocess.run(["xdotool"] + [str(part) for part in command], check=True, timeout=30)

    def close(self):
        for process in reversed(list(self.processes.values())):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
        self.processes = {}
        shutil.rmtree(self.folder, ignore_errors=True)
