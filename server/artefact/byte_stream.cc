#include "server/artefact/byte_stream.h"

#include <archive_entry.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr size_t kPiece = 128 << 10;

}  // namespace

FileStream::FileStream(int fd, int64_t offset) : fd_(fd), at_(offset), buffer_(kPiece, '\0') {
  struct stat info = {};
  if (::fstat(fd, &info) == 0) size_ = info.st_size;
}

absl::StatusOr<std::string_view> FileStream::Next() {
  for (;;) {
    const ssize_t got = ::pread(fd_, buffer_.data(), buffer_.size(), at_);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return HostError("can't read the archive");
    at_ += got;
    return std::string_view(buffer_.data(), static_cast<size_t>(got));
  }
}

// Never beyond the end, where a cut file would look whole.
int64_t FileStream::Skip(int64_t bytes) {
  const int64_t passed = std::clamp<int64_t>(size_ - at_, 0, bytes);
  at_ += passed;
  return passed;
}

absl::StatusOr<std::string_view> CheckedStream::Next() {
  absl::StatusOr<std::string_view> piece = from_.Next();
  if (!piece.ok()) return piece;
  const auto bytes = static_cast<int64_t>(piece->size());
  if (bytes > left_) {
    return absl::InvalidArgumentError(absl::StrCat(
        what_, " yields more bytes than the submission may have; make the image smaller"));
  }
  left_ -= bytes;
  size_ += bytes;
  hash_.Update(*piece);
  return piece;
}

absl::Status CheckedStream::Finish() {
  for (;;) {
    ASSIGN_OR_RETURN(const std::string_view piece, Next());
    if (piece.empty()) break;
  }
  sha256_ = hash_.FinishHex();
  return absl::OkStatus();
}

StreamArchive::StreamArchive(ByteStream& from, Form form)
    : from_(from), form_(form), buffer_(kPiece, '\0'), reader_(archive_read_new()) {
  archive* reader = reader_.get();
  if (form == Form::kTar) {
    archive_read_support_format_tar(reader);
  } else {
    SupportCompression(reader);
    archive_read_support_format_raw(reader);
  }
  archive_read_support_format_empty(reader);
}

absl::Status StreamArchive::Open() {
  if (archive_read_open2(reader_.get(), this, nullptr, Read, SkipSome, nullptr) != ARCHIVE_OK) {
    return Failure(form_ == Form::kTar ? "it is no tar archive" : "it can't be decompressed");
  }
  if (archive_filter_count(reader_.get()) > (form_ == Form::kTar ? 1 : 2)) {
    return absl::InvalidArgumentError("it is compressed more than once; once is enough");
  }
  return absl::OkStatus();
}

absl::StatusOr<bool> StreamArchive::NextEntry(archive_entry** entry) {
  const int result = archive_read_next_header(reader_.get(), entry);
  if (result == ARCHIVE_EOF) return false;
  if (result == ARCHIVE_OK || result == ARCHIVE_WARN) return true;
  return Failure("it is broken");
}

absl::StatusOr<std::string_view> StreamArchive::NextData() {
  const la_ssize_t got = archive_read_data(reader_.get(), buffer_.data(), buffer_.size());
  if (got < 0) return Failure("it is broken");
  return std::string_view(buffer_.data(), static_cast<size_t>(got));
}

la_ssize_t StreamArchive::Read(archive* reader, void* self, const void** buffer) {
  auto& stream = *static_cast<StreamArchive*>(self);
  const absl::StatusOr<std::string_view> piece = stream.from_.Next();
  if (!piece.ok()) {
    stream.failure_ = piece.status();
    archive_set_error(reader, EINVAL, "unreadable");
    return ARCHIVE_FATAL;
  }
  *buffer = piece->data();
  return static_cast<la_ssize_t>(piece->size());
}

la_int64_t StreamArchive::SkipSome(archive*, void* self, la_int64_t bytes) {
  return static_cast<StreamArchive*>(self)->from_.Skip(bytes);
}

absl::Status StreamArchive::Failure(absl::string_view what) const {
  if (!failure_.ok()) return failure_;
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", ArchiveReason(reader_.get())));
}

absl::StatusOr<std::string_view> EntryStream::Next() {
  if (!open_) {
    open_ = true;
    RETURN_IF_ERROR(archive_.Open());
    archive_entry* entry = nullptr;
    ASSIGN_OR_RETURN(const bool content, archive_.NextEntry(&entry));
    empty_ = !content;
  }
  if (empty_) return std::string_view();
  return archive_.NextData();
}

bool IsCompressed(int file) {
  std::array<char, 6> bytes = {};
  const ssize_t got = ::pread(file, bytes.data(), bytes.size(), 0);
  const std::string_view magic(bytes.data(), static_cast<size_t>(std::max<ssize_t>(got, 0)));
  using std::string_view_literals::operator""sv;
  for (const std::string_view known :
       {"\x1f\x8b"sv, "\xfd" "7zXZ\0"sv, "BZh"sv, "\x28\xb5\x2f\xfd"sv}) {
    if (magic.starts_with(known)) return true;
  }
  // A skippable frame may precede zstd's own.
  return magic.size() >= 4 && (magic[0] & 0xf0) == 0x50 && magic.substr(1, 3) == "\x2a\x4d\x18";
}

void SupportCompression(archive* reader) {
  archive_read_support_filter_gzip(reader);
  archive_read_support_filter_zstd(reader);
  archive_read_support_filter_xz(reader);
  archive_read_support_filter_bzip2(reader);
}

}  // namespace myograde::server
