#include "server/api/resources.h"

#include <algorithm>
#include <memory>
#include <regex>
#include <string>
#include <string_view>

#include <absl/strings/str_cat.h>

#include "server/api/negotiation.h"
#include "server/api/openapi/document.h"
#include "server/web/files.h"

namespace myograde::server {
namespace {

// Scripts and styles are those of this server, and there is no other origin for anything; a text
// can't become markup or a script, whatever a script does with it (trusted types).
constexpr char kContentPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "require-trusted-types-for 'script'; trusted-types 'none'";

void SetHeaders(Response& response) {
  for (const auto& [name, value] : {
           std::pair("Content-Security-Policy", kContentPolicy),
           std::pair("X-Content-Type-Options", "nosniff"),
           std::pair("X-Frame-Options", "DENY"),
           std::pair("Referrer-Policy", "no-referrer"),
           std::pair("Cross-Origin-Opener-Policy", "same-origin"),
           std::pair("Cross-Origin-Resource-Policy", "same-origin"),
           std::pair("Permissions-Policy", "camera=(), geolocation=(), microphone=()"),
           std::pair("Cache-Control", "no-cache"),
       }) {
    response.SetHeader(name, value);
  }
}

// A text that lives as long as the server, compressed if the client takes that.
void SendConstant(const Document& document, const Request& request, Response& response) {
  const bool packed = !document.packed.empty() && TakesCoding(request, "gzip");
  const std::string& tag = packed ? document.packed_tag : document.tag;
  response.SetHeader("Vary", "Accept-Encoding");
  if (AnswersWithTag(request, tag, response)) return;
  if (packed) response.SetHeader("Content-Encoding", "gzip");
  response.SetContent(packed ? document.packed : document.text, document.type);
}

Document PageOf(const WebFile& file) {
  return MakeDocument(std::string(file.type), std::string(file.text), std::string(file.packed));
}

// The page that a path leads to which is none itself: no path or a version alone to the first page,
// a page of a version that is not here to that of this program's. "" if there is no such page.
std::string PageInstead(const Documents& documents, std::string_view path) {
  while (path.ends_with('/')) path.remove_suffix(1);
  const size_t slash = std::min(path.find('/'), path.size());
  std::string version(path.substr(0, slash));
  static const std::regex kVersion("[0-9]+[.][0-9]+");
  if (!path.empty() && !std::regex_match(version, kVersion)) return "";
  const auto first = documents.lower_bound(version + "/");
  if (first == documents.end() || !first->first.starts_with(version + "/")) {
    // MAJOR.MINOR of the program, which is what the documents' folders are named by.
    const std::string_view own = MYOGRADE_VERSION;
    version = own.substr(0, own.rfind('.'));
  }
  const std::string_view page = slash < path.size() ? path.substr(slash + 1) : "index.html";
  std::string found = absl::StrCat(version, "/", std::string(page));
  return documents.contains(found) ? found : "";
}

void ServeDocument(const Documents& documents, const Request& request, Response& response) {
  const std::string root = "/docs";
  SetHeaders(response);
  std::string path = request.path.substr(root.size());
  if (!path.empty()) path.erase(0, 1);
  const auto found = documents.find(path);
  if (found == documents.end()) {
    if (const std::string instead = PageInstead(documents, path); !instead.empty()) {
      response.status = 302;
      response.SetHeader("Location", absl::StrCat(root, "/", instead));
      return;
    }
    if (ServeUnknownPage(request, response)) return;
    response.status = 404;
    response.SetContent(documents.empty() ?
                        "This server has no documents: build them with ./dev docs, or read "
                        "README.md.\n"
                                          : absl::StrCat("Page not found. ", root,
                                                         " has the documents.\n"),
                        "text/plain; charset=utf-8");
    return;
  }
  SendConstant(found->second, request, response);
}

}  // namespace

bool ServeUnknownPage(const Request& request, Response& response) {
  static const Document kPage = [] {
    const std::span<const WebFile> files = WebFiles();
    return PageOf(*std::find_if(files.begin(), files.end(),
                                [](const WebFile& file) { return file.path == "/"; }));
  }();
  const auto [begin, end] = request.headers.equal_range("accept");
  const bool browser = std::any_of(begin, end, [](const auto& header) {
    return header.second.find("text/html") != std::string::npos;
  });
  const bool of_api = request.path.starts_with("/v1/") || request.path == "/metrics";
  if (!browser || of_api || (request.method != "GET" && request.method != "HEAD")) return false;
  SetHeaders(response);
  response.status = 404;
  response.SetContent(kPage.text, kPage.type);
  return true;
}

void AddPages(Routes& routes, const ApiContext& context) {
  const auto document = std::make_shared<const std::string>(OpenApiDocument());
  routes.Get("/v1/openapi.json", Action::kReadApi, [document](const Request& request) -> ApiResult {
    RETURN_IF_ERROR(CheckParameters(request, {}));
    return ApiAnswer{.text = document, .tagged = true};
  });
  routes.GetPage("/docs(?:/[^/]+)*/?",
                 std::bind_front(ServeDocument, std::cref(context.documents)));
  for (const WebFile& file : WebFiles()) {
    const Document page = PageOf(file);
    routes.GetPage(std::string(file.path), [page](const Request& request, Response& response) {
      SetHeaders(response);
      SendConstant(page, request, response);
    });
  }
}

}  // namespace myograde::server
