#include "server/api/views.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace myograde::server {
namespace {

TEST(Paging, ReadsAPage) {
  Request request;
  EXPECT_EQ(ReadPage(request)->before, std::numeric_limits<int64_t>::max());
  EXPECT_EQ(ReadPage(request)->limit, 100);
  request.params = {{"before", "9223372036854775807"}, {"limit", "1000"}};
  EXPECT_EQ(ReadPage(request)->before, std::numeric_limits<int64_t>::max());
  EXPECT_EQ(ReadPage(request)->limit, 1000);
}

TEST(Paging, RefusesWhatIsNoNumberInItsRange) {
  for (const char* key : {"before", "limit"}) {
    for (const char* value : {"", "0", "-1", "+1", " 1", "1 ", "1.0", "1e2", "0x1", "x", "1,2",
                              "9223372036854775808", "99999999999999999999999", "١"}) {
      Request request;
      request.params = {{key, value}};
      const absl::Status status = ReadPage(request).status();
      EXPECT_TRUE(absl::IsInvalidArgument(status)) << key << "=" << value;
      EXPECT_NE(status.message().find(key), absl::string_view::npos) << status;
    }
  }
  Request request;
  request.params = {{"limit", "1001"}};
  EXPECT_FALSE(ReadPage(request).ok());
}

TEST(Paging, SaysWhereTheNextPageBegins) {
  Request request;
  request.path = "/v1/submissions";
  request.params = {{"team", "a&b>; rel=\"x\"\r\nY: 1"}, {"limit", "2"}, {"before", "9"}};
  ApiAnswer answer;
  AddNextPage(request, /*more=*/true, 7, answer);
  EXPECT_EQ(answer.body["next_before"], 7);
  EXPECT_EQ(answer.next, "/v1/submissions?before=7&limit=2&team=a%26b%3E%3B%20rel%3D%22x%22%0D%0AY%3A"
                         "%201");
  ApiAnswer last;
  AddNextPage(request, /*more=*/false, 7, last);
  EXPECT_TRUE(last.body["next_before"].is_null());
  EXPECT_EQ(last.next, "");
}

}  // namespace
}  // namespace myograde::server
