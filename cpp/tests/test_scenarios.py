"""The outage scenarios of the Rust and Python clients, word for word, and those of several servers, with the client in C++."""

from test_outages import *  # noqa: F403
from test_servers import (  # noqa: F401
    elsewhere,
    test_a_session_and_a_watch_go_to_the_server_that_has_the_map,
    test_a_session_asks_again_who_has_the_map_when_its_server_is_gone,
    test_the_second_server_is_asked_where_the_first_is_gone,
)
