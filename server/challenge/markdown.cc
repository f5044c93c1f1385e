#include "server/challenge/markdown.h"

#include <cmark.h>

#include <memory>
#include <string_view>

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int kDeepest = 30;

std::string TextOf(const char* text) { return text == nullptr ? "" : text; }

bool MayBeLinked(std::string_view url) {
  if (url.starts_with('/')) return !url.starts_with("//");
  return url.starts_with("https://") || url.starts_with("http://") || url.starts_with("mailto:");
}

void AddChildren(cmark_node* node, int depth, Json& children);

// Adds a node, or its children in its place where it is not shown itself.
void AddNode(cmark_node* node, int depth, Json& nodes) {
  const cmark_node_type type = cmark_node_get_type(node);
  if (type == CMARK_NODE_HTML_BLOCK || type == CMARK_NODE_HTML_INLINE || depth > kDeepest) return;
  Json made = {{"type", cmark_node_get_type_string(node)}};
  switch (type) {
    case CMARK_NODE_TEXT:
    case CMARK_NODE_CODE:
    case CMARK_NODE_CODE_BLOCK:
      made["text"] = TextOf(cmark_node_get_literal(node));
      nodes.push_back(std::move(made));
      return;
    case CMARK_NODE_HEADING:
      made["level"] = cmark_node_get_heading_level(node);
      break;
    case CMARK_NODE_LIST:
      made["ordered"] = cmark_node_get_list_type(node) == CMARK_ORDERED_LIST;
      made["start"] = cmark_node_get_list_start(node);
      break;
    case CMARK_NODE_LINK:
    case CMARK_NODE_IMAGE: {
      const std::string url = TextOf(cmark_node_get_url(node));
      if (!MayBeLinked(url)) return AddChildren(node, depth, nodes);
      made["type"] = "link";
      made["url"] = url;
      break;
    }
    default:
      break;
  }
  made["children"] = Json::array();
  AddChildren(node, depth + 1, made["children"]);
  nodes.push_back(std::move(made));
}

void AddChildren(cmark_node* node, int depth, Json& children) {
  for (cmark_node* child = cmark_node_first_child(node); child != nullptr;
       child = cmark_node_next(child)) {
    AddNode(child, depth, children);
  }
}

}  // namespace

Json MarkdownTree(const std::string& text) {
  const std::unique_ptr<cmark_node, decltype(&cmark_node_free)> document(
      cmark_parse_document(text.data(), text.size(), CMARK_OPT_VALIDATE_UTF8), cmark_node_free);
  Json blocks = Json::array();
  AddChildren(document.get(), 0, blocks);
  return blocks;
}

}  // namespace myograde::server
