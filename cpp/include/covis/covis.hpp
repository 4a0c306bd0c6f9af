//! All of the client: connections, sessions, live maps, errors. `covis/eigen.hpp` stands alone.

#pragma once

#include "covis/client.hpp"
#include "covis/error.hpp"
#include "covis/map.hpp"
#include "covis/options.hpp"
#include "covis/pose.hpp"
#include "covis/session.hpp"
