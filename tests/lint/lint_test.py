"""What the lint takes for the name of a track."""

import unittest

import lint


class TrackNames(unittest.TestCase):
    def names(self, text, track, path="server/api/api.cc"):
        return lint.names_track(path, text, track)

    def test_uses(self):
        for text in ('#include "sim/hand/rules.h"', "HandFacts facts;", "hand_facts", "kHandKind",
                     'if (track == "hand")', '"demo-hand"', "'hand.json'", "hand::Facts", "namespace hand {",
                     "MYOGRADE_HAND", "// of the hand track", "the track hand", "`hand`"):
            self.assertTrue(self.names(text, "hand"), text)
        self.assertTrue(self.names("BimanualReachFacts", "bimanual_reach"))
        self.assertTrue(self.names("add_subdirectory(arm)", "arm", "sim/CMakeLists.txt"))

    def test_english_and_other_words(self):
        for track, text in (("hand", "// resolves it by hand; on the other hand, (hand) hands"),
                            ("hand", "// hand-written, first-hand"), ("hand", "handle, Handler, kHandled"),
                            ("hand", '"submit it again"'), ("finger", "Fingerprint, fingerprints_"),
                            ("leg", "legal, LegacyForm, elegant"), ("arm", "alarm, Army, warm, kArmed")):
            self.assertFalse(self.names(text, track), text)
        self.assertFalse(self.names("# by hand\nadd_library(x y.cc)", "hand", "sim/CMakeLists.txt"))


if __name__ == "__main__":
    unittest.main()
