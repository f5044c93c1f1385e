// What is wrong with certificates.
#include "server/http/tcp_listener.h"

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/server/http/certificate.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

class TlsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = absl::StrCat(testing::TempDir(), "/tls-", getpid());
    std::filesystem::create_directory(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const char* name) const { return folder_ + "/" + name; }
  std::string ErrorOf(const char* certificate, const char* key) const {
    return std::string(TlsContext::Load(path(certificate), path(key)).status().message());
  }
  std::string WarningAbout(absl::Duration from, absl::Duration until) const {
    MakeCertificate(path("cert"), path("key"), from, until);
    const auto context = TlsContext::Load(path("cert"), path("key"));
    EXPECT_TRUE(context.ok()) << context.status();
    return context.ok() ? (*context)->warning : "";
  }

  std::string folder_;
};

TEST_F(TlsTest, MistakesOfFilesAreNamed) {
  MakeCertificate(path("cert"), path("key"));
  MakeCertificate(path("other-cert"), path("other-key"));
  MakeCertificate(path("locked-cert"), path("locked-key"), -absl::Hours(1), absl::Hours(9999),
                  "secret");
  std::ofstream(path("text")) << "no PEM\n";
  EXPECT_THAT(ErrorOf("none", "key"),
              HasSubstr("none: the certificate can't be read (No such file"));
  EXPECT_THAT(ErrorOf("cert", "none"), HasSubstr("none: the key can't be read (No such file"));
  EXPECT_THAT(ErrorOf("text", "key"), HasSubstr("text: holds no certificate in PEM"));
  EXPECT_THAT(ErrorOf("cert", "text"), HasSubstr("text: holds no private key in PEM"));
  EXPECT_THAT(ErrorOf("cert", "cert"), HasSubstr("cert: holds no private key in PEM"));
  EXPECT_THAT(ErrorOf("cert", "other-key"), HasSubstr("is not the key of the certificate"));
  EXPECT_THAT(ErrorOf("locked-cert", "locked-key"), HasSubstr("the key has a passphrase"));
  EXPECT_EQ(ErrorOf("cert", "key"), "");
}

TEST_F(TlsTest, DatesThatClientsWillRefuseAreAWarning) {
  const absl::Duration day = absl::Hours(24);
  EXPECT_EQ(WarningAbout(-day, 100 * day), "");
  EXPECT_THAT(WarningAbout(-2 * day, -day), HasSubstr("has expired"));
  EXPECT_THAT(WarningAbout(day, 100 * day), HasSubstr("not valid yet"));
  EXPECT_THAT(WarningAbout(-day, 3 * day + absl::Hours(1)), HasSubstr("expires in 3 days"));
  MakeCertificate(path("cert"), path("key"));
  chmod(path("key").c_str(), 0644);
  EXPECT_THAT(TlsContext::Load(path("cert"), path("key")).value()->warning,
              HasSubstr("every user of this host can read the key"));
}

}  // namespace
}  // namespace myograde::server
