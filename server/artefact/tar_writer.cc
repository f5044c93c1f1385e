#include "server/artefact/tar_writer.h"

#include <archive.h>
#include <archive_entry.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr size_t kPieceBytes = 256 << 10;

using TarHeader = std::unique_ptr<archive_entry, void (*)(archive_entry*)>;

TarHeader MakeTarHeader(const std::string& path, const Entry& entry) {
  TarHeader header(archive_entry_new(), archive_entry_free);
  archive_entry_set_pathname(header.get(), path.c_str());
  archive_entry_set_mtime(header.get(), entry.time, 0);
  archive_entry_set_uid(header.get(), 0);
  archive_entry_set_gid(header.get(), 0);
  const bool open_to_all = entry.executable || entry.type == EntryType::kFolder;
  archive_entry_set_perm(header.get(), open_to_all ? 0755 : 0644);
  switch (entry.type) {
    case EntryType::kFile:
      archive_entry_set_filetype(header.get(), AE_IFREG);
      archive_entry_set_size(header.get(), entry.size);
      break;
    case EntryType::kFolder:
      archive_entry_set_filetype(header.get(), AE_IFDIR);
      break;
    case EntryType::kLink:
      archive_entry_set_filetype(header.get(), AE_IFLNK);
      archive_entry_set_symlink(header.get(), entry.target.c_str());
      break;
  }
  return header;
}

}  // namespace

TarWriter::TarWriter(Sink sink) : sink_(std::move(sink)), writer_(archive_write_new()) {
  archive_write_set_format_pax_restricted(writer_.get());
  archive_write_add_filter_none(writer_.get());
  archive_write_set_bytes_in_last_block(writer_.get(), 1);
  const auto write = [](archive*, void* self, const void* data, size_t size) -> la_ssize_t {
    auto& writer = *static_cast<TarWriter*>(self);
    writer.status_ = writer.sink_({static_cast<const char*>(data), size});
    return writer.status_.ok() ? static_cast<la_ssize_t>(size) : -1;
  };
  // What can't be opened fails at the first entry.
  (void)archive_write_open(writer_.get(), this, nullptr, write, nullptr);
}

absl::Status TarWriter::Begin(const std::string& path, const Entry& entry) {
  const TarHeader header = MakeTarHeader(path, entry);
  return archive_write_header(writer_.get(), header.get()) == ARCHIVE_OK ? absl::OkStatus() : Failed();
}

absl::Status TarWriter::Write(std::string_view bytes) {
  const la_ssize_t put = archive_write_data(writer_.get(), bytes.data(), bytes.size());
  return put == static_cast<la_ssize_t>(bytes.size()) ? absl::OkStatus() : Failed();
}

absl::Status TarWriter::Copy(int file, const std::string& path, int64_t size, FolderOf whose,
                             const std::function<void(std::string_view piece)>& wrote) {
  const auto changed = [&] {
    const std::string what = absl::StrCat(Quoted(path), " changed while it was packed");
    return whose == FolderOf::kParticipant
               ? absl::InvalidArgumentError(absl::StrCat(what, "; try again"))
               : absl::DataLossError(absl::StrCat("the submission's ", what));
  };
  struct stat info = {};
  if (::fstat(file, &info) != 0) return Unreadable(path, whose);
  if (!S_ISREG(info.st_mode) || info.st_size != size) return changed();
  std::string buffer(kPieceBytes, '\0');
  for (int64_t left = size; left > 0;) {
    const auto wanted = static_cast<size_t>(std::min<int64_t>(left, std::ssize(buffer)));
    const ssize_t got = ::read(file, buffer.data(), wanted);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Unreadable(path, whose);
    if (got == 0) return changed();
    const std::string_view piece(buffer.data(), static_cast<size_t>(got));
    RETURN_IF_ERROR(Write(piece));
    wrote(piece);
    left -= got;
  }
  return absl::OkStatus();
}

absl::Status TarWriter::Close() {
  return archive_write_close(writer_.get()) == ARCHIVE_OK ? absl::OkStatus() : Failed();
}

absl::Status TarWriter::Failed() const {
  if (!status_.ok()) return status_;
  return absl::UnavailableError(
      absl::StrCat("writing the archive failed: ", ArchiveReason(writer_.get())));
}

}  // namespace myograde::server
