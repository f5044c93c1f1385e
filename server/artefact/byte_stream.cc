#include "server/artefact/byte_stream.h"

#include <archive_entry.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"

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

int64_t FileStream::Seek(int64_t offset, int whence) {
  const int64_t to = offset + (whence == SEEK_SET ? 0 : whence == SEEK_CUR ? at_ : size_);
  return to < 0 ? -1 : at_ = to;
}

absl::StatusOr<std::string_view> CheckedStream::Next() {
  ASSIGN_OR_RETURN(const std::string_view piece, from_.Next());
  const int64_t bytes = std::ssize(piece);
  if (bytes > left_) {
    return absl::InvalidArgumentError(absl::StrCat(
        what_, " unpacks to more bytes than a submission may have; make the image smaller"));
  }
  left_ -= bytes;
  size_ += bytes;
  hash_.Update(piece);
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
    : from_(from),
      form_(form),
      buffer_(kPiece, '\0'),
      reader_(archive_read_new(), archive_read_free) {
  archive* const reader = reader_.get();
  if (form == Form::kPacked || form == Form::kSubmission) {
    archive_read_support_filter_gzip(reader);
    archive_read_support_filter_zstd(reader);
    archive_read_support_filter_xz(reader);
    archive_read_support_filter_bzip2(reader);
  }
  if (form == Form::kPacked) archive_read_support_format_raw(reader);
  if (form != Form::kPacked) archive_read_support_format_tar(reader);
  if (form == Form::kTar || form == Form::kPacked) archive_read_support_format_empty(reader);
  archive_read_set_callback_data(reader, this);
  archive_read_set_read_callback(reader, [](archive* a, void* self, const void** buffer) {
    auto& stream = *static_cast<StreamArchive*>(self);
    const absl::StatusOr<std::string_view> piece = stream.from_.Next();
    if (!piece.ok()) {
      stream.failure_ = piece.status();
      archive_set_error(a, EINVAL, "unreadable");
      return la_ssize_t{ARCHIVE_FATAL};
    }
    *buffer = piece->data();
    return la_ssize_t{std::ssize(*piece)};
  });
  archive_read_set_skip_callback(reader, [](archive*, void* self, la_int64_t bytes) {
    return la_int64_t{static_cast<StreamArchive*>(self)->from_.Skip(bytes)};
  });
  if (form != Form::kSubmission) return;
  archive_read_support_format_zip(reader);
  // The list of a zip's entries, with their modes and links, is at its end.
  archive_read_set_seek_callback(reader, [](archive*, void* self, la_int64_t offset, int whence) {
    const int64_t at = static_cast<StreamArchive*>(self)->from_.Seek(offset, whence);
    return la_int64_t{at < 0 ? ARCHIVE_FATAL : at};
  });
}

absl::Status StreamArchive::Open(std::string_view what) {
  if (archive_read_open1(reader_.get()) != ARCHIVE_OK) {
    if (!what.empty()) return Failure(what);
    return Failure(form_ == Form::kPacked ? "it can't be decompressed" : "it is not a tar archive");
  }
  if (form_ != Form::kSubmission && compressions() > (form_ == Form::kPacked ? 1 : 0)) {
    return absl::InvalidArgumentError("it is compressed more than once; compress it only once");
  }
  return absl::OkStatus();
}

absl::StatusOr<bool> StreamArchive::NextEntry(archive_entry** entry, std::string_view what) {
  const int result = archive_read_next_header(reader_.get(), entry);
  if (result == ARCHIVE_EOF) return false;
  if (result == ARCHIVE_OK || result == ARCHIVE_WARN) return true;
  return Failure(what);
}

absl::StatusOr<std::string_view> StreamArchive::NextData(std::string_view what) {
  const la_ssize_t got = archive_read_data(reader_.get(), buffer_.data(), buffer_.size());
  if (got < 0) return Failure(what);
  return std::string_view(buffer_.data(), static_cast<size_t>(got));
}

absl::Status StreamArchive::Failure(std::string_view what) const {
  if (!failure_.ok()) return failure_;
  return absl::InvalidArgumentError(
      absl::StrCat(std::string(what), ": ", ArchiveReason(reader_.get())));
}

std::string ArchiveReason(archive* reader) {
  const char* text = archive_error_string(reader);
  std::string reason = text != nullptr ? std::string(text).substr(0, 200) : "unreadable";
  std::ranges::replace_if(reason, std::not_fn(absl::ascii_isprint), ' ');
  reason.erase(reason.find_last_not_of(' ') + 1);
  return reason;
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

}  // namespace myograde::server
