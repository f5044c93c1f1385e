// Builds archives, valid and hostile.
#pragma once

#include <archive.h>
#include <archive_entry.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/server/artefact/raw_tar.h"

namespace myograde::server {

class TestFolder {
 public:
  TestFolder() {
    namespace fs = std::filesystem;
    std::string name = (fs::temp_directory_path() / "myograde-artefact.XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~TestFolder() { std::filesystem::remove_all(path_); }
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// One entry of an archive that libarchive writes.
struct Raw {
  std::string path;
  std::string content = {};
  mode_t mode = AE_IFREG | 0644;
  std::string link = {};  // target of a symbolic link
  std::string hard_link = {};
};

enum class Kind { kTar, kTarGz, kTarZst, kTarXz, kTarBz2, kZip, kEncryptedZip };

inline void AddFilter(archive* a, Kind kind) {
  if (kind == Kind::kTarGz) archive_write_add_filter_gzip(a);
  if (kind == Kind::kTarZst) archive_write_add_filter_zstd(a);
  if (kind == Kind::kTarXz) archive_write_add_filter_xz(a);
  if (kind == Kind::kTarBz2) archive_write_add_filter_bzip2(a);
}

inline void WriteArchive(const std::string& path, const std::vector<Raw>& entries,
                         Kind kind = Kind::kTar) {
  archive* a = archive_write_new();
  if (kind == Kind::kZip || kind == Kind::kEncryptedZip) {
    archive_write_set_format_zip(a);
  } else {
    archive_write_set_format_pax_restricted(a);
  }
  AddFilter(a, kind);
  if (kind == Kind::kEncryptedZip) {
    ASSERT_EQ(archive_write_set_options(a, "zip:encryption=traditional"), ARCHIVE_OK);
    ASSERT_EQ(archive_write_set_passphrase(a, "secret"), ARCHIVE_OK);
  }
  ASSERT_EQ(archive_write_open_filename(a, path.c_str()), ARCHIVE_OK);
  for (const Raw& raw : entries) {
    archive_entry* entry = archive_entry_new();
    archive_entry_set_pathname(entry, raw.path.c_str());
    archive_entry_set_mode(entry, raw.mode);
    archive_entry_set_mtime(entry, 1'700'000'000, 0);
    if (!raw.link.empty()) archive_entry_set_symlink(entry, raw.link.c_str());
    if (!raw.hard_link.empty()) archive_entry_set_hardlink(entry, raw.hard_link.c_str());
    const bool has_content = (raw.mode & AE_IFMT) == AE_IFREG && raw.hard_link.empty();
    archive_entry_set_size(entry, has_content ? static_cast<int64_t>(raw.content.size()) : 0);
    ASSERT_EQ(archive_write_header(a, entry), ARCHIVE_OK) << archive_error_string(a);
    if (has_content) archive_write_data(a, raw.content.data(), raw.content.size());
    archive_entry_free(entry);
  }
  ASSERT_EQ(archive_write_close(a), ARCHIVE_OK);
  archive_write_free(a);
}

// Bytes packed by a filter only, around any content.
inline void WritePacked(const std::string& path, std::string_view bytes, Kind kind) {
  archive* a = archive_write_new();
  archive_write_set_format_raw(a);
  AddFilter(a, kind);
  ASSERT_EQ(archive_write_open_filename(a, path.c_str()), ARCHIVE_OK);
  archive_entry* entry = archive_entry_new();
  archive_entry_set_filetype(entry, AE_IFREG);
  ASSERT_EQ(archive_write_header(a, entry), ARCHIVE_OK);
  archive_entry_free(entry);
  archive_write_data(a, bytes.data(), bytes.size());
  ASSERT_EQ(archive_write_close(a), ARCHIVE_OK);
  archive_write_free(a);
}

inline constexpr char kManifest[] = R"({"name": "walker", "command": ["./policy"]})";

inline void MakeFile(const std::string& path, const std::string& content, mode_t mode) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << content;
  ASSERT_EQ(::chmod(path.c_str(), mode), 0);
}

}  // namespace myograde::server
