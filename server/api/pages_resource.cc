#include "server/api/pages_resource.h"

#include <absl/strings/str_cat.h>

#include <string>
#include <string_view>
#include <utility>

#include "server/api/entity_tag.h"
#include "server/api/negotiation.h"
#include "server/web/files.h"

namespace myograde::server {
namespace {

// Scripts and styles are those of this server, and there is no other origin for anything; a text
// can't become markup or a script, whatever a script does with it (trusted types).
constexpr char kContentPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "require-trusted-types-for 'script'; trusted-types 'none'";

void SetHeaders(httplib::Response& response) {
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
    response.set_header(name, value);
  }
}

// As a provider's content: cpp-httplib would compress another body once more for each request.
void SetContent(std::string_view content, const std::string& type, httplib::Response& response) {
  response.set_content_provider(content.size(), type,
                                [content](size_t offset, size_t length, httplib::DataSink& sink) {
                                  return sink.write(content.data() + offset, length);
                                });
}

// MAJOR.MINOR of the program, which is what the documents' folders are named by.
std::string DocumentsVersion() {
  const std::string_view version = MYOGRADE_VERSION;
  return std::string(version.substr(0, version.rfind('.')));
}

}  // namespace

void PagesResource::ServeDocument(const httplib::Request& request,
                                  httplib::Response& response) const {
  const std::string root = "/docs";
  SetHeaders(response);
  std::string path = request.path.substr(root.size());
  if (!path.empty()) path.erase(0, 1);
  const std::string own = DocumentsVersion();
  if (path.empty() && documents_.contains(own + "/index.html")) {
    response.status = 302;
    response.set_header("Location", absl::StrCat(root, "/", own, "/index.html"));
    return;
  }
  const auto found = documents_.find(path);
  if (found == documents_.end()) {
    response.status = 404;
    response.set_content(documents_.empty() ? "The documents are not on this server: ./dev docs "
                                              "makes them, and README.md has a tour.\n"
                                            : absl::StrCat("There is no such page. ", root,
                                                           " leads to the documents.\n"),
                         "text/plain; charset=utf-8");
    return;
  }
  response.set_header("Vary", "Accept-Encoding");
  response.set_header("ETag", found->second.tag);
  if (HasCurrent(request, found->second.tag)) {
    response.status = 304;
    return;
  }
  response.set_content(found->second.text, found->second.type);
}

void PagesResource::Install(Routes& routes) {
  routes.GetPage("/docs(?:/[^/]+)*/?",
                 [this](const httplib::Request& request, httplib::Response& response) {
                   ServeDocument(request, response);
                 });
  for (const WebFile& file : WebFiles()) {
    const std::string tag = EntityTagOf(file.text);
    const std::string packed_tag = EntityTagOf(file.packed);
    routes.GetPage(std::string(file.path), [&file, tag, packed_tag](const httplib::Request& request,
                                                                    httplib::Response& response) {
      const bool packed = !file.packed.empty() && TakesCoding(request, "gzip");
      SetHeaders(response);
      response.set_header("Vary", "Accept-Encoding");
      response.set_header("ETag", packed ? packed_tag : tag);
      if (HasCurrent(request, packed ? packed_tag : tag)) {
        response.status = 304;
        return;
      }
      if (packed) response.set_header("Content-Encoding", "gzip");
      SetContent(packed ? file.packed : file.text, std::string(file.type), response);
    });
  }
}

}  // namespace myograde::server
