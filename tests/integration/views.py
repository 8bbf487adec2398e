"""Drives `rmem view` in a pseudo-terminal. Arguments: rmem, the memory, how it ends, and a collection to begin with, if any.
It ends by the key q, by a signal (TERM, INT, HUP or QUIT), by q after it was suspended and continued (TSTP: by a
signal, ctrl-z: by that key), or by a terminal that is gone (gone; gone-session, where the
terminal is that of its session). Prints the exit code; fails where something is not seen, or the terminal is not left as it was."""
import codecs
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time

rmem, memory, end, *given = sys.argv[1:]
ROWS, COLUMNS = 24, 90
UP, DOWN, LEFT, RIGHT = b"\x1b[A", b"\x1b[B", b"\x1b[D", b"\x1b[C"
master, slave = pty.openpty()
fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
before = termios.tcgetattr(slave)


def session():
    """Makes the terminal that of the session."""
    if end == "gone-session":
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)


child = subprocess.Popen(
    [rmem, "--memory", memory, "view", *given],
    stdin=slave, stdout=slave, stderr=slave, start_new_session=True, preexec_fn=session,
)


class Screen:
    """What is seen: texts at places, of what a terminal obeys."""

    TOKEN = re.compile(r"\x1b\[([?0-9;]*)([A-Za-z])|\x1b[()].|\x1b[^\[()]|[^\x1b]", re.DOTALL)

    def __init__(self):
        self.decoder = codecs.getincrementaldecoder("utf-8")()
        self.rest, self.raw = "", b""
        self.clear()

    def clear(self):
        self.cells = [[" "] * COLUMNS for _ in range(ROWS)]
        self.row = self.column = 0

    def feed(self, data):
        self.raw += data
        text = self.rest + self.decoder.decode(data)
        at = 0
        while match := self.TOKEN.match(text, at):
            self.obey(match)
            at = match.end()
        self.rest = text[at:]

    def obey(self, match):
        parameters, command = match.group(1), match.group(2)
        if command == "H":
            row, column = (parameters or "1;1").split(";")
            self.row, self.column = int(row) - 1, int(column) - 1
        elif command == "J":
            self.clear()
        elif match.group()[0] != "\x1b" and self.row < ROWS and self.column < COLUMNS:
            self.cells[self.row][self.column] = match.group()
            self.column += 1

    def text(self):
        return "\n".join("".join(row).rstrip() for row in self.cells)


screen = Screen()


def read(seconds):
    if select.select([master], [], [], seconds)[0]:
        try:
            screen.feed(os.read(master, 65536))
        except OSError:
            # The program has closed its end.
            return False
        return True
    return False


def wait(text, seconds=60):
    """Reads until the text is seen."""
    until = time.time() + seconds
    while text not in screen.text():
        assert time.time() < until, f"never seen: {text!r} on\n{screen.text()}"
        read(0.2)


def press(keys):
    os.write(master, keys)


def ask(key, text):
    """Presses a key that asks, and answers in place of what was there."""
    press(key)
    wait(": " if key == b"/" else "sort")
    press(b"\x7f" * 40 + text.encode() + b"\r")


if given:
    cups = given[0]
else:
    cups = "robmem.cups"
    wait("collections")
    wait("robmem.plans")
    press(DOWN + RIGHT)
    wait("robmem.plans: 1 document")
    press(b"p")
    wait("done      pick-up A")
    press(LEFT)
    wait("robmem.plans: 1 document")
    press(LEFT)
    wait("collections")
    press(UP + b"\r")
wait("cup 1")
wait(f"{cups}: 2 documents")
# Another process changes the collection that is open.
new = [rmem, "--memory", memory, "insert", cups, "{name: 'cup from elsewhere'}"]
subprocess.run(new, check=True, capture_output=True)
wait("elsewhere")
ask(b"/", "{name: 'cup 2'}")
wait(f"{cups}: 1 document, {{name: 'cup 2'}}")
assert "cup 1" not in screen.text(), screen.text()
ask(b"/", "{name: {$is: 1}}")
wait("unknown")
press(b"\x7f" * 40 + b"{}\r")
wait("elsewhere")
ask(b"s", "{name: -1}")
wait("sorted by {name: -1}")
places = [screen.text().index(name) for name in ("elsewhere", "cup 2", "cup 1")]
assert places == sorted(places), screen.text()
press(b"e")
wait("keys_examined")
press(b"\x1b")
while "keys_examined" in screen.text():
    assert read(60), screen.text()
wait("3 documents")
assert termios.tcgetattr(slave) != before, "the terminal is not in raw mode"
if end.startswith("gone"):
    os.close(slave)
    os.close(master)
    print(child.wait(timeout=60))
    sys.exit()
suspends = {"TSTP": lambda: child.send_signal(signal.SIGTSTP), "ctrl-z": lambda: press(b"\x1a")}
if end in suspends:
    suspends[end]()
    assert os.WIFSTOPPED(os.waitpid(child.pid, os.WUNTRACED)[1]), "it is not suspended"
    while read(0.2):
        pass
    assert termios.tcgetattr(slave) == before, "the terminal of a suspended browser is not as it was"
    screen.clear()
    child.send_signal(signal.SIGCONT)
    wait("3 documents")
    assert termios.tcgetattr(slave) != before, "the terminal is not in raw mode again"
    end = "q"
if end == "q":
    press(b"q")
else:
    child.send_signal(getattr(signal, "SIG" + end))
code = child.wait(timeout=60)
while read(0.2):
    pass
assert termios.tcgetattr(slave) == before, "the terminal is not as it was"
raw = screen.raw
assert b"\x1b[?1049h" in raw and raw.rindex(b"\x1b[?1049l") > raw.rindex(b"\x1b[?1049h"), "the other screen is left open"
assert raw.rindex(b"\x1b[?25h") > raw.rindex(b"\x1b[?25l"), "the cursor is hidden"
print(code)
