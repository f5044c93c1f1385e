// Refusals that are to be heard.
#include "tests/server/api/gate_world.h"

namespace myograde::server {
namespace {

using ::testing::StartsWith;

TEST_F(GateTest, ARefusedBodyIsReadSoThatItsSenderHearsWhy) {
  Start(Limits());
  for (const char* head : {"POST /upload HTTP/1.1\r\nContent-Length: 20000000\r\n\r\n",
                           "POST /upload HTTP/1.1\r\nContent-Length: 5000000\r\n"
                           "Content-Type: multipart/form-data; boundary=x\r\n\r\n"}) {
    Client client(path(), "a");
    client.Send(head);
    client.Send(std::string(5'000'000, 'x'));  // would fail half-way if nobody read it
    EXPECT_THAT(client.Receive(10), "HTTP/1.1 4");
  }
  EXPECT_EQ(body_bytes_, 0);
}

}  // namespace
}  // namespace myograde::server
