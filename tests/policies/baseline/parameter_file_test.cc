#include "policies/baseline/parameter_file.h"

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace myograde::baseline {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class ParameterFile : public testing::Test {
 protected:
  void SetUp() override {
    for (const ParameterInfo& info : kWalkerParameters) {
      content_["parameters"][info.name] = info.start;
    }
  }
  void TearDown() override { std::filesystem::remove(path_); }

  WalkerNumbers Read() {
    std::ofstream(path_) << content_.dump();
    return ReadWalkerNumbers(path_);
  }

  nlohmann::json content_;
  std::string path_ = testing::TempDir() + "myograde-parameter-file.json";
};

TEST_F(ParameterFile, IsReadByName) { EXPECT_EQ(Read(), StartingNumbers()); }

TEST_F(ParameterFile, NamesWhatIsWrong) {
  EXPECT_THAT([] { ReadWalkerNumbers("/no/such/file"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("/no/such/file is not there")));
  content_["parameters"]["speed"] = 1000;
  EXPECT_THAT([&] { Read(); },
              ThrowsMessage<std::runtime_error>(HasSubstr("speed is 1000, must be from 0.2 to 2")));
  content_["parameters"].erase("speed");
  EXPECT_THAT([&] { Read(); },
              ThrowsMessage<std::runtime_error>(HasSubstr("has no number \"speed\"")));
  content_ = 5;
  EXPECT_THAT([&] { Read(); }, ThrowsMessage<std::runtime_error>(HasSubstr("no JSON object")));
}

}  // namespace
}  // namespace myograde::baseline
