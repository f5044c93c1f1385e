// A host's text in Markdown as a tree of what may be shown: there is no HTML in it, whatever the text has.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace myograde::server {

// The blocks of a text in CommonMark, an array of nodes: {"type", "children"}, where children are nodes, and
//
//   heading      "level" (1 to 6)
//   list         "ordered", "start"; its children are items
//   code_block   "text" and no children, as of text and code
//   link         "url": http, https, mailto, or of this server ("/docs/…")
//
// and without keys of their own paragraph, item, block_quote, thematic_break, emph, strong, softbreak and
// linebreak. HTML is left out, and a picture is a link. A link to anything else is its text alone; what is nested
// more than 30 deep is left out.
nlohmann::json MarkdownTree(const std::string& text);

}  // namespace myograde::server
