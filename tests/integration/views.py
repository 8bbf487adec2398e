"""Drives `rmem view` in a pseudo-terminal. Arguments: rmem, the memory, and how it ends: q, TERM, INT or HUP.
Prints what was seen; fails where the terminal is not left as it was."""
import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time

rmem, memory, end = sys.argv[1:]
master, slave = pty.openpty()
fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 90, 0, 0))
before = termios.tcgetattr(slave)
child = subprocess.Popen([rmem, "--memory", memory, "view"], stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
seen = b""


def wait(text, seconds=60):
    """Reads until the text was seen."""
    global seen
    until = time.time() + seconds
    start = len(seen)
    while text not in seen[start:]:
        assert time.time() < until, f"never seen: {text!r} in {seen!r}"
        if select.select([master], [], [], 0.2)[0]:
            seen += os.read(master, 65536)


wait(b"collections")
os.write(master, b"\r")
wait(b"cup 1")
# Another process changes the collection that is open.
subprocess.run([rmem, "--memory", memory, "insert", "robmem.cups", "{name: 'cup from elsewhere'}"], check=True, capture_output=True)
wait(b"elsewhere")
os.write(master, b"/")
wait(b"query")
os.write(master, b"{name: 'cup 2'}\r")
wait(b", {name: 'cup 2'}")
os.write(master, b"e")
wait(b"documents_examined")
assert termios.tcgetattr(slave) != before, "the terminal is not in raw mode"
if end == "q":
    os.write(master, b"q")
else:
    child.send_signal(getattr(signal, "SIG" + end))
code = child.wait(timeout=60)
while select.select([master], [], [], 0.2)[0]:
    seen += os.read(master, 65536)
assert termios.tcgetattr(slave) == before, "the terminal is not as it was"
assert b"\x1b[?1049h" in seen and seen.rindex(b"\x1b[?1049l") > seen.rindex(b"\x1b[?1049h"), "the other screen is left open"
assert seen.rindex(b"\x1b[?25h") > seen.rindex(b"\x1b[?25l"), "the cursor is hidden"
print(code)
