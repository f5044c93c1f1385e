// The 10 x 10 heights of the ground around the person that the observation
// holds. Row 0 lies ahead, column 0 to the left; entry 10 i + j.
#pragma once

#include <span>

#include "sim/locomotion/rules.h"
#include "sim/locomotion/terrain.h"
#include "sim/model/height_map.h"

namespace myograde::sim {

// As the official code does it: 0.5 m pitch, 2.5 m ahead and left of the
// person to 2.0 m behind and right, raw heights of the field in m, looked up
// with a cell of 0.2 m by 0.05 m, which is half the true width of a column.
void OfficialHeightMap(const Terrain& terrain, const Pose& pose, std::span<double> out);

// Centres of cells of `pitch` m, centred on the person, turned so that the
// rows are ahead and behind in the person's heading (the x axis laid on the
// ground). Heights in m relative to the ground under the person.
void HeadingHeightMap(const Terrain& terrain, const Pose& pose, double pitch,
                      std::span<double> out);

}  // namespace myograde::sim
