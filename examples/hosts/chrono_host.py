"""A C++ program in the manner of Project Chrono as the host (chrono_style.cpp with force_law.h): implicit, loop C.

python examples/hosts/chrono_host.py [--steps 8 4 2 1] [--seconds 10]
"""

from functools import partial

import reference
from c_host import program, run

HOST = "C++ program, Newmark"
LOOPS = {"C": partial(run, partial(program, "chrono_style.cpp", "-lstdc++"), "C")}

if __name__ == "__main__":
    reference.main(HOST, LOOPS, sources=("chrono_style.cpp", "car.h"))
