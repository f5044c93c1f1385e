// A host's text as a tree: what is shown, and that nothing of it can be markup or lead elsewhere than it says.
#include "server/challenge/markdown.h"

#include <gtest/gtest.h>

#include <string>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

Json Text(const std::string& text) { return {{"type", "text"}, {"text", text}}; }

TEST(MarkdownTree, HasBlocksAndWhatIsInThem) {
  EXPECT_EQ(MarkdownTree(""), Json::array());
  EXPECT_EQ(MarkdownTree("## A *cup*\n"),
            Json::array({{{"type", "heading"},
                          {"level", 2},
                          {"children", {Text("A "), {{"type", "emph"}, {"children", {Text("cup")}}}}}}}));
  const Json list = MarkdownTree("3. `x`\n")[0];
  EXPECT_EQ(list["type"], "list");
  EXPECT_EQ(list["ordered"], true);
  EXPECT_EQ(list["start"], 3);
  EXPECT_EQ(list["children"][0]["children"][0]["children"][0],
            (Json{{"type", "code"}, {"text", "x"}}));
  EXPECT_EQ(MarkdownTree("```\na < b\n```\n")[0], (Json{{"type", "code_block"}, {"text", "a < b\n"}}));
}

TEST(MarkdownTree, LeavesHtmlOut) {
  EXPECT_EQ(MarkdownTree("<script>alert(1)</script>\n"), Json::array());
  EXPECT_EQ(MarkdownTree("a<b onclick=x>b\n")[0]["children"], Json::array({Text("a"), Text("b")}));
}

TEST(MarkdownTree, LinksLeadToWhereTheyMay) {
  for (const std::string url : {"https://example.org/", "http://a", "mailto:a@b", "/docs"}) {
    const Json link = MarkdownTree("[a](" + url + ")")[0]["children"][0];
    EXPECT_EQ(link, (Json{{"type", "link"}, {"url", url}, {"children", {Text("a")}}}));
  }
  for (const std::string url : {"javascript:alert(1)", "data:text/html,x", "//example.org", "x", "JAVASCRIPT:x"}) {
    EXPECT_EQ(MarkdownTree("[a](" + url + ")")[0]["children"], Json::array({Text("a")})) << url;
  }
  EXPECT_EQ(MarkdownTree("![a](https://example.org/x.png)")[0]["children"][0]["type"], "link");
}

TEST(MarkdownTree, DeepNestingEnds) {
  const std::string text = MarkdownTree(std::string(5000, '>') + " a\n").dump();
  EXPECT_LT(text.size(), 3000u);
  EXPECT_EQ(text.find("\"a\""), std::string::npos);
}

TEST(MarkdownTree, BytesThatAreNoTextAreReplaced) {
  EXPECT_NO_THROW(MarkdownTree("a \xff b").dump());
}

}  // namespace
}  // namespace myograde::server
