// The vectors of the elbow track: 9 observations, 6 actions.
#pragma once

#include "protocol/layout_tables.h"

namespace myograde {

inline constexpr double kElbowControlPeriod = 0.02;  // s

namespace layout_tables {

// The observation is the official one, part by part in its order.
TrackLayout ElbowLayout();

}  // namespace layout_tables
}  // namespace myograde
