#include "server/http/router.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

class RouterTest : public ::testing::Test {
 protected:
  RouterTest() {
    Add("GET", "/v1/things");
    Add("POST", "/v1/things");
    Add("POST", R"(/v1/things/(\d{1,18})/end)");
    Add("DELETE", R"(/v1/things/(\d{1,18}))");
  }

  void Add(const std::string& method, const std::string& pattern) {
    router_.Add({method, pattern, Action::kReadApi, [method, pattern](const Request& request, Response& response) {
                   response.SetContent(absl::StrCat(method, " ", absl::StrJoin(request.matches, " ")), "text/plain");
                 }});
  }

  Response Ask(const std::string& method, const std::string& path) const {
    Request request;
    request.method = method;
    request.path = path;
    Response response;
    router_.Serve(request, response);
    return response;
  }

  Router router_;
};

TEST_F(RouterTest, TheAddressOfARequestAnswersIt) {
  EXPECT_EQ(Ask("GET", "/v1/things").text, "GET ");
  EXPECT_EQ(Ask("HEAD", "/v1/things").text, "GET ");
  EXPECT_EQ(Ask("POST", "/v1/things/7/end").text, "POST /v1/things/7/end 7");
}

TEST_F(RouterTest, AnotherMethodIsToldTheMethodsOfItsPath) {
  EXPECT_THAT(Ask("PUT", "/v1/things").text, HasSubstr("it has GET, HEAD, OPTIONS, POST\""));
  EXPECT_THAT(Ask("GET", "/v1/things/7/end").text, HasSubstr("it has OPTIONS, POST\""));
  const Response response = Ask("GET", "/v1/things/7");
  EXPECT_EQ(response.status, 405);
  EXPECT_THAT(response.text, HasSubstr("it has DELETE, OPTIONS"));
}

TEST_F(RouterTest, ThereIsNothingAtOtherPaths) {
  for (const char* path : {"", "/", "/v1/thing", "/v1/things/", "/v1/things/7/", "/v1/things/x",
                           "/v1/things/1234567890123456789", "x/v1/things/7"}) {
    EXPECT_EQ(Ask("GET", path).status, 404) << path;
  }
}

}  // namespace
}  // namespace myograde::server
