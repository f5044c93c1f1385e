#include "protocol/bridge/frames.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

namespace myograde {
namespace {

using ::testing::HasSubstr;

template <typename F>
std::vector<std::byte> Bytes(const F& frame) {
  std::vector<std::byte> bytes(sizeof(F));
  std::memcpy(bytes.data(), &frame, sizeof(F));
  return bytes;
}

template <typename F>
std::string Problem(const F& frame) {
  return std::string(ParseBridgeFrame(Bytes(frame)).status().message());
}

ActionFrame GoodAction() {
  ActionFrame frame = {};
  frame.header = MakeHeader<ActionFrame>(FrameType::kAction);
  frame.episode = 2;
  frame.step = 7;
  frame.size = 55;
  for (int i = 0; i < 55; ++i) frame.values[i] = 0.01 * i;
  return frame;
}

HelloFrame GoodHello() {
  HelloFrame frame = {};
  frame.header = MakeHeader<HelloFrame>(FrameType::kHello);
  frame.protocol_version = 1;
  frame.convention = ActionConvention::kDirect;
  frame.parameters.size = 2;
  std::memcpy(frame.parameters.text, "{}", 2);
  return frame;
}

ReadyFrame GoodReady() {
  ReadyFrame frame = {};
  frame.header = MakeHeader<ReadyFrame>(FrameType::kReady);
  frame.episode = 3;
  return frame;
}

FaultFrame GoodFault() {
  FaultFrame frame = {};
  frame.header = MakeHeader<FaultFrame>(FrameType::kFault);
  frame.fault = BridgeFault::kPolicyExit;
  frame.value = 256;
  std::strcpy(frame.detail, "exited with status 1");
  return frame;
}

TEST(Frames, GoodOnesArrive) {
  const auto action = ParseBridgeFrame(Bytes(GoodAction()));
  ASSERT_TRUE(action.ok()) << action.status();
  EXPECT_EQ(std::get<ActionFrame>(*action).step, 7);
  EXPECT_EQ(std::get<ActionFrame>(*action).values[54], 0.54);
  const auto hello = ParseBridgeFrame(Bytes(GoodHello()));
  ASSERT_TRUE(hello.ok()) << hello.status();
  EXPECT_EQ(std::get<HelloFrame>(*hello).parameters.size, 2u);
  const auto ready = ParseBridgeFrame(Bytes(GoodReady()));
  ASSERT_TRUE(ready.ok()) << ready.status();
  EXPECT_EQ(std::get<ReadyFrame>(*ready).episode, 3);
  const auto fault = ParseBridgeFrame(Bytes(GoodFault()));
  ASSERT_TRUE(fault.ok()) << fault.status();
  EXPECT_STREQ(std::get<FaultFrame>(*fault).detail, "exited with status 1");
}

template <typename F>
void RefusesOtherLengths(const F& frame) {
  std::vector<std::byte> bytes = Bytes(frame);
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(ParseBridgeFrame({bytes.data(), size}).ok()) << size;
    // A header that states the truncated size must not help.
    std::vector<std::byte> cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    if (size < sizeof(FrameHeader)) continue;
    const auto honest = static_cast<uint32_t>(size);
    std::memcpy(cut.data() + offsetof(FrameHeader, size), &honest, sizeof(honest));
    EXPECT_FALSE(ParseBridgeFrame(cut).ok()) << size;
  }
  bytes.push_back(std::byte{0});
  EXPECT_FALSE(ParseBridgeFrame(bytes).ok());
}

TEST(Frames, EveryOtherLengthIsRefused) {
  RefusesOtherLengths(GoodAction());
  RefusesOtherLengths(GoodHello());
  RefusesOtherLengths(GoodReady());
  RefusesOtherLengths(GoodFault());
}

TEST(Frames, HeadersAreChecked) {
  ActionFrame frame = GoodAction();
  frame.header.magic ^= 1;
  EXPECT_THAT(Problem(frame), HasSubstr("magic"));
  frame = GoodAction();
  frame.header.version = 2;
  EXPECT_THAT(Problem(frame), HasSubstr("version"));
  frame = GoodAction();
  frame.header.type = static_cast<FrameType>(99);
  EXPECT_THAT(Problem(frame), HasSubstr("type"));
  // The bridge may not send what only the simulator sends.
  frame.header.type = FrameType::kPublish;
  EXPECT_THAT(Problem(frame), HasSubstr("type"));
  // A type of another size.
  frame.header.type = FrameType::kHello;
  EXPECT_THAT(Problem(frame), HasSubstr("size"));
}

TEST(Frames, ActionsAreChecked) {
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity(),
                             -std::numeric_limits<double>::infinity()}) {
    ActionFrame frame = GoodAction();
    frame.values[54] = wrong;
    EXPECT_THAT(Problem(frame), HasSubstr("not finite"));
    // Beyond the used entries nothing is checked.
    frame = GoodAction();
    frame.values[55] = wrong;
    EXPECT_TRUE(ParseBridgeFrame(Bytes(frame)).ok());
  }
  ActionFrame frame = GoodAction();
  frame.size = kMaxActionSize + 1;
  EXPECT_THAT(Problem(frame), HasSubstr("too long"));
  frame = GoodAction();
  frame.step = -1;
  EXPECT_THAT(Problem(frame), HasSubstr("negative"));
  frame = GoodAction();
  frame.episode = -1;
  EXPECT_THAT(Problem(frame), HasSubstr("negative"));
}

TEST(Frames, ConventionAndLengthOfParametersAreChecked) {
  HelloFrame frame = GoodHello();
  frame.convention = static_cast<ActionConvention>(2);
  EXPECT_THAT(Problem(frame), HasSubstr("convention"));
  frame = GoodHello();
  frame.parameters.size = kMaxParameterBytes;
  EXPECT_TRUE(ParseBridgeFrame(Bytes(frame)).ok()) << "only their track reads them";
  frame.parameters.size = kMaxParameterBytes + 1;
  EXPECT_THAT(Problem(frame), HasSubstr("parameters are too long"));
  ReadyFrame ready = GoodReady();
  ready.parameters.size = 0xffffffffu;
  EXPECT_THAT(Problem(ready), HasSubstr("parameters are too long"));
}

TEST(Frames, FaultsAreChecked) {
  for (const uint32_t wrong : {0u, 5u, 0xffffffffu}) {
    FaultFrame frame = GoodFault();
    frame.fault = static_cast<BridgeFault>(wrong);
    EXPECT_THAT(Problem(frame), HasSubstr("fault is unknown"));
  }
  FaultFrame frame = GoodFault();
  std::memset(frame.detail, 'x', sizeof(frame.detail));
  EXPECT_THAT(Problem(frame), HasSubstr("no end"));
  for (const char wrong : {'\n', '\x1b', '\x7f', '\x80'}) {
    frame = GoodFault();
    frame.detail[3] = wrong;
    EXPECT_THAT(Problem(frame), HasSubstr("printable"));
  }
}

TEST(Frames, RandomBytesBehindAGoodHeaderNeverPassWithANumberThatIsNone) {
  EXPECT_TRUE(rc::check([](const std::vector<uint8_t>& noise) {
    ActionFrame frame = GoodAction();
    auto* body = reinterpret_cast<uint8_t*>(&frame) + sizeof(FrameHeader);
    const size_t room = sizeof(frame) - sizeof(FrameHeader);
    for (size_t i = 0; i < noise.size() && !noise.empty(); ++i) body[i * 37 % room] = noise[i];
    const auto parsed = ParseBridgeFrame(Bytes(frame));
    if (!parsed.ok()) return;
    const auto& action = std::get<ActionFrame>(*parsed);
    RC_ASSERT(action.size <= static_cast<uint32_t>(kMaxActionSize));
    for (uint32_t i = 0; i < action.size; ++i) RC_ASSERT(std::isfinite(action.values[i]));
  }));
}

}  // namespace
}  // namespace myograde
