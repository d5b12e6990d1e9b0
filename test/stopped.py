"""How long a program takes to end after a signal, for tests on a machine that other processes use as well."""
import os
import resource
import time

TICKS = os.sysconf("SC_CLK_TCK")  # per second
IDLE = (3, 4)  # columns of a processor's times: idle, waiting for input or output


def busy_time():
    """Return the time for which a processor of this machine has computed, as the mean of all processors [s]."""
    with open("/proc/stat") as file:
        times = [int(word) for word in file.readline().split()[1:9]]
    return sum(time for column, time in enumerate(times) if column not in IDLE) / TICKS / os.cpu_count()


def own_time(process):
    """Return the time for which a running process has computed, summed over threads [s]."""
    with open("/proc/%d/stat" % process.pid) as file:
        words = file.read().rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / TICKS


def children_time():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def stop(process, number, limit=30):
    """Send a signal to a process, and wait for its end for at most limit [s]. Return its exit code and the time until
    its end [s], less the time for which a processor computed for others: on a busy machine the process waits for it."""
    begin, busy, own, children = time.monotonic(), busy_time(), own_time(process), children_time()
    process.send_signal(number)
    code = process.wait(limit)
    used = children_time() - children - own
    others = max(0, busy_time() - busy - used / os.cpu_count())
    return code, time.monotonic() - begin - others
