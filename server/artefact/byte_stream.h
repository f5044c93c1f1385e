// Bytes that are read once, from the beginning to the end, and may be archives in each other.
#pragma once

#include <archive.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/sha256.h"

namespace myograde::server {

class ByteStream {
 public:
  virtual ~ByteStream() = default;
  // The next bytes, valid until the next call; empty at the end. InvalidArgumentError: the bytes are
  // no archive, or a broken one; other codes: the host can't read them.
  virtual absl::StatusOr<std::string_view> Next() = 0;
  // Passes over at most `bytes` without reading them; the number passed over.
  virtual int64_t Skip([[maybe_unused]] int64_t bytes) { return 0; }
  // As lseek(2) within what it yields; below 0: it can't.
  virtual int64_t Seek([[maybe_unused]] int64_t offset, [[maybe_unused]] int whence) { return -1; }
};

// A file from `offset` on. Does not own it, and does not use its position.
class FileStream : public ByteStream {
 public:
  explicit FileStream(int fd, int64_t offset = 0);
  absl::StatusOr<std::string_view> Next() override;
  int64_t Skip(int64_t bytes) override;
  int64_t Seek(int64_t offset, int whence) override;  // REQUIRES: `offset` was 0

 private:
  const int fd_;
  int64_t at_;
  int64_t size_ = 0;
  std::string buffer_;
};

// Counts what another stream yields, up to a limit, and hashes it.
class CheckedStream : public ByteStream {
 public:
  // `what`: names the bytes in errors. `left`: the bytes that it and others may still yield
  // together. Both streams share it, and it outlives them.
  CheckedStream(ByteStream& from, std::string what, int64_t& left)
      : from_(from), what_(std::move(what)), left_(left) {}
  absl::StatusOr<std::string_view> Next() override;

  // Reads to the end; then the number of bytes and their SHA-256 are known.
  absl::Status Finish();
  int64_t size() const { return size_; }
  const std::string& sha256() const { return sha256_; }  // "" before Finish()

 private:
  ByteStream& from_;
  const std::string what_;
  int64_t& left_;
  int64_t size_ = 0;
  Sha256 hash_;
  std::string sha256_;
};

// An archive that is read from a stream, which it does not own.
class StreamArchive {
 public:
  // Which parsers may read it: each more adds attack surface.
  enum class Form {
    kTar,         // an uncompressed tar, which may be empty
    kPacked,      // any bytes, compressed at most once
    kSent,        // a tar of the daemon's
    kSubmission,  // a tar or zip, compressed at most once
  };
  StreamArchive(ByteStream& from, Form form);

  // After construction: whether it could be opened. Of the errors of these three, those that are
  // the archive's say `what` in front of libarchive's reason.
  absl::Status Open(std::string_view what = {});
  // False at the end of the archive. Also for damage that libarchive would pass over: a file would
  // be missing.
  absl::StatusOr<bool> NextEntry(archive_entry** entry, std::string_view what = "it is broken");
  // The next bytes of the entry; empty at its end.
  absl::StatusOr<std::string_view> NextData(std::string_view what = "it is broken");
  // Of the entry's header in the stream, which must have begun at its first byte.
  int64_t header_position() const { return archive_read_header_position(reader_.get()); }
  // How much of the stream was read, and how often it turned out to be compressed.
  int64_t bytes_read() const { return archive_filter_bytes(reader_.get(), -1); }
  int compressions() const { return archive_filter_count(reader_.get()) - 1; }
  // Of the stream, if that is why the archive can't be read any further.
  const absl::Status& failure() const { return failure_; }

 private:
  absl::Status Failure(std::string_view what) const;

  ByteStream& from_;
  const Form form_;
  absl::Status failure_;
  std::string buffer_;
  std::unique_ptr<archive, int (*)(archive*)> reader_;
};

// Why libarchive can't read or write any further, in words that may be shown, as part of one line.
std::string ArchiveReason(archive* archive);

// The content of an archive's first entry; nothing if it has none. By default, what a stream yields
// once it is decompressed, whatever of gzip, zstd, xz and bzip2 it is; the bytes themselves if they
// are not compressed.
class EntryStream : public ByteStream {
 public:
  explicit EntryStream(ByteStream& from, StreamArchive::Form form = StreamArchive::Form::kPacked)
      : archive_(from, form) {}
  absl::StatusOr<std::string_view> Next() override;

 private:
  StreamArchive archive_;
  bool open_ = false;
  bool empty_ = false;
};

// Whether a file is compressed in a way that is accepted, by its first bytes.
bool IsCompressed(int file);

}  // namespace myograde::server
