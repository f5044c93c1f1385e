#include "server/api/pages_resource.h"

#include <optional>
#include <string>

#include "server/api/entity_tag.h"
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

}  // namespace

void PagesResource::Install(Routes& routes) {
  for (const WebFile& file : WebFiles()) {
    const std::string tag = EntityTagOf(file.text);
    routes.GetPage(std::string(file.path), [&file, tag](const httplib::Request& request,
                                                        httplib::Response& response) {
      SetHeaders(response);
      response.set_header("ETag", tag);
      for (size_t i = 0; i < request.get_header_value_count("If-None-Match"); ++i) {
        if (!NamesEntityTag(request.get_header_value("If-None-Match", i), tag)) continue;
        response.status = 304;
        return;
      }
      response.set_content(file.text.data(), file.text.size(), std::string(file.type));
    });
  }
}

}  // namespace myograde::server
