#include "server/api/pages_resource.h"

#include <string>
#include <string_view>
#include <utility>

#include "server/api/entity_tag.h"
#include "server/api/negotiation.h"
#include "server/web/files.h"

namespace myograde::server {
namespace {

// Scripts and styles are those of this server, and there is no other origin for anything; a text can't
// become markup or a script, whatever a script does with it (trusted types).
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
  response.set_content_provider(
      content.size(), type, [content](size_t offset, size_t length, httplib::DataSink& sink) {
        return sink.write(content.data() + offset, length);
      });
}

}  // namespace

void PagesResource::Install(Routes& routes) {
  for (const WebFile& file : WebFiles()) {
    const std::string tag = EntityTagOf(file.text);
    const std::string packed_tag = EntityTagOf(file.packed);
    routes.GetPage(std::string(file.path), [&file, tag, packed_tag](
                                               const httplib::Request& request,
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
