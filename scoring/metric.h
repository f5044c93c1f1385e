// The numbers that a track is judged by, as data: what prints or stores them needs to know no track.
#pragma once

#include <string_view>

namespace myograde::scoring {

enum class Better { kLess, kMore, kNeither };

struct Metric {
  // Where an episode's value comes from.
  enum class Source {
    kJudged,     // from the verdict; kept with it as it was first written
    kFacts,      // from the fact `of` of the track, read whenever it is needed
    kOverSteps,  // no episode has one: the sum of the metric `of` over all episodes by the steps
                 // of all, so that a long episode weighs more than one that ends at once
  };
  // Where results show it, beside the boards' own columns.
  enum class Shown { kAlways, kWithOfficialFigures, kNever };

  std::string_view name;   // key in JSON, with its unit: "time_s"
  std::string_view title;  // for people: "time"
  std::string_view unit;   // "s"; "" has none
  Better better = Better::kNeither;
  int digits = 4;          // after the point, for people
  Shown shown = Shown::kNever;
  Source source = Source::kJudged;
  std::string_view of = "";
  bool ranked = false;     // boards may rank by its mean
  bool spread = false;     // results tell how far the episodes lie apart
};

}  // namespace myograde::scoring
