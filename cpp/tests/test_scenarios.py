"""The outage scenarios of the Rust and Python clients, word for word, with the client in C++."""

from test_outages import *  # noqa: F403
