"""Runs an example of MAVSDK-Python as it stands: `run_theirs.py FILE ADDRESS PORT`. Only where it connects to is another
place, and its server has a port of its own: several run beside each other on one computer."""

import functools
import runpy
import sys

import mavsdk


def main(file, address, port):
    begin, connect = mavsdk.System.__init__, mavsdk.System.connect
    mavsdk.System.__init__ = functools.partialmethod(begin, port=port)
    mavsdk.System.connect = lambda system, system_address=None: connect(system, system_address=address)
    runpy.run_path(file, run_name="__main__")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
