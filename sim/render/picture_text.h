// What is written into a picture.
#pragma once

#include <string>

namespace myograde::sim {

// Lines, with "\n" between them. Characters other than printable ASCII are shown as '?', as
// MuJoCo's font has no others.
struct PictureText {
  // A table at the top on the left: names, and values beside them.
  std::string names;
  std::string values;
  std::string title;    // at the top on the right
  std::string caption;  // at the bottom on the left
};

}  // namespace myograde::sim
