#include "server/artefact/artefact.h"

#include <archive.h>
#include <archive_entry.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <utility>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/program_head.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/listing.h"
#include "server/artefact/submission.h"
#include "server/base/names.h"

namespace myograde::server {
namespace {

constexpr char kManifestFile[] = "policy.json";

// Writes a submission's entries as a tar: the same bytes for the same entries.
class TarWriter {
 public:
  explicit TarWriter(ByteSink sink)
      : sink_(std::move(sink)), writer_(archive_write_new(), archive_write_free) {
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
  // Its archive refers to it.
  TarWriter(const TarWriter&) = delete;
  TarWriter& operator=(const TarWriter&) = delete;

  // Begins an entry: without an owner, with the mode 0755 or 0644, and the time in whole seconds.
  // Of a file, entry.size bytes follow. Errors, of all four: the sink's; UnavailableError: another
  // one.
  absl::Status Begin(const std::string& path, const Entry& entry) {
    const std::unique_ptr<archive_entry, void (*)(archive_entry*)> owner(archive_entry_new(),
                                                                         archive_entry_free);
    archive_entry* const header = owner.get();
    archive_entry_set_pathname(header, path.c_str());
    archive_entry_set_mtime(header, entry.time, 0);
    archive_entry_set_uid(header, 0);
    archive_entry_set_gid(header, 0);
    const bool folder = entry.type == EntryType::kFolder;
    const bool link = entry.type == EntryType::kLink;
    archive_entry_set_perm(header, entry.executable || folder ? 0755 : 0644);
    archive_entry_set_filetype(header, folder ? AE_IFDIR : link ? AE_IFLNK : AE_IFREG);
    if (link) archive_entry_set_symlink(header, entry.target.c_str());
    if (entry.type == EntryType::kFile) archive_entry_set_size(header, entry.size);
    return archive_write_header(writer_.get(), header) == ARCHIVE_OK ? absl::OkStatus() : Failed();
  }

  absl::Status Write(std::string_view bytes) {
    const la_ssize_t put = archive_write_data(writer_.get(), bytes.data(), bytes.size());
    return put == static_cast<la_ssize_t>(bytes.size()) ? absl::OkStatus() : Failed();
  }

  // Writes the content of a begun file `path` of `size` bytes from an open one, and tells `wrote`
  // of each piece. An error of FolderOf's kind if it can't be read, is not a file or has another size.
  absl::Status Copy(int file, const std::string& path, int64_t size, FolderOf whose,
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
    FileStream bytes(file);
    for (int64_t left = size;;) {
      const absl::StatusOr<std::string_view> piece = bytes.Next();
      if (!piece.ok()) return Unreadable(path, whose);
      left -= std::ssize(*piece);
      if (left < 0 || (piece->empty() && left > 0)) return changed();
      if (piece->empty()) return absl::OkStatus();
      RETURN_IF_ERROR(Write(*piece));
      wrote(*piece);
    }
  }

  absl::Status Close() {
    return archive_write_close(writer_.get()) == ARCHIVE_OK ? absl::OkStatus() : Failed();
  }

 private:
  absl::Status Failed() const {
    if (!status_.ok()) return status_;
    return absl::UnavailableError(
        absl::StrCat("can't write the archive: ", ArchiveReason(writer_.get())));
  }

  const ByteSink sink_;
  absl::Status status_;
  std::unique_ptr<archive, int (*)(archive*)> writer_;
};

// What PackArtefact was asked for.
struct Packing {
  const std::string& archive;
  const ArtefactLimits& limits;
  const ByteProgress& progress;
  const std::string& name;  // "": the submission's own
};

// The text of a policy.json that is made or changed here.
std::string ManifestText(const nlohmann::json& manifest) {
  return manifest.dump(2, ' ', false, nlohmann::json::error_handler_t::ignore) + "\n";
}

// Writes the listed files, which `open` opens. `about`: what to write as policy.json; "": the file
// itself.
absl::Status WriteListed(const Listing& listing, const std::string& about, const Packing& packing,
                         const std::function<Fd(const std::string& path)>& open) {
  const Fd archive(
      ::open(packing.archive.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
  if (!archive.valid()) return HostError(absl::StrCat("can't write the archive ", packing.archive));
  TarWriter tar([&](std::string_view bytes) {
    const bool written = WriteAll(archive.get(), bytes).ok();
    return written ? absl::OkStatus() : HostError("can't write the archive");
  });
  int64_t done = 0;
  const auto wrote = [&](std::string_view piece) {
    done += std::ssize(piece);
    if (packing.progress) packing.progress(done, listing.bytes());
  };
  for (const auto& [path, listed] : listing.entries()) {
    Entry entry = listed;
    const bool replaced = path == kManifestFile && !about.empty();
    if (replaced) entry.size = std::ssize(about);
    RETURN_IF_ERROR(tar.Begin(path, entry));
    if (replaced) {
      RETURN_IF_ERROR(tar.Write(about));
    } else if (entry.type == EntryType::kFile) {
      const Fd file = open(path);
      if (!file.valid()) return Unreadable(path, FolderOf::kParticipant);
      RETURN_IF_ERROR(tar.Copy(file.get(), path, entry.size, FolderOf::kParticipant, wrote));
    }
  }
  return tar.Close();
}

absl::StatusOr<PolicyManifest> PackFolder(const std::string& folder, const Packing& packing) {
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!root.valid()) return Unreadable(folder, FolderOf::kParticipant);
  ASSIGN_OR_RETURN(SubmittedManifest submitted, ReadSubmittedManifest(root.get(), packing.name));
  RETURN_IF_ERROR(CleanName(submitted.manifest.name, "policy.json: \"name\"").status());
  Listing listing(packing.limits);
  RETURN_IF_ERROR(ListFolder(root.get(), FolderOf::kParticipant, listing));
  const std::string about = packing.name.empty() ? "" : ManifestText(submitted.json);
  RETURN_IF_ERROR(WriteListed(listing, about, packing, [&](const std::string& path) {
    return OpenBeneath(root.get(), path, O_RDONLY | O_NONBLOCK);
  }));
  return std::move(submitted.manifest);
}

// Packs one file with the manifest that belongs to it.
absl::Status PackWithManifest(const std::string& source, const std::string& name, bool executable,
                              const nlohmann::json& about_it, const Packing& packing) {
  Listing listing(packing.limits);
  RETURN_IF_ERROR(listing.CleanPath(name).status());
  struct stat info = {};
  if (::stat(source.c_str(), &info) != 0) return Unreadable(source, FolderOf::kParticipant);
  RETURN_IF_ERROR(listing.AddBytes(name, info.st_size));
  ASSIGN_OR_RETURN(Entry* const file, listing.Add(name, EntryType::kFile));
  RETURN_IF_ERROR(listing.Add(kManifestFile, EntryType::kFile).status());
  file->size = info.st_size;
  file->time = KeptTime(info.st_mtim.tv_sec);
  file->executable = executable;
  return WriteListed(listing, ManifestText(about_it), packing, [&](const std::string&) {
    return Fd(::open(source.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  });
}

absl::StatusOr<PolicyManifest> PackProgram(const std::string& program, const Packing& packing) {
  const std::string base = std::filesystem::path(program).filename().string();
  PolicyManifest manifest;
  manifest.name = packing.name.empty() ? PolicyNameOf(base) : packing.name;
  manifest.command = {"./" + base};
  RETURN_IF_ERROR(PackWithManifest(program, base, /*executable=*/true,
                       {{"name", manifest.name}, {"command", manifest.command}}, packing));
  return manifest;
}

// An image is sent as it is: the daemon unpacks it, and checks it there.
absl::StatusOr<PolicyManifest> PackImage(const std::string& image, const Packing& packing) {
  constexpr char kName[] = "image.tar";
  PolicyManifest manifest;
  manifest.name = packing.name;
  if (manifest.name.empty()) {
    const Fd file(::open(image.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
    if (!file.valid()) return Unreadable(image, FolderOf::kParticipant);
    const std::string stem = std::filesystem::path(image).filename().string();
    manifest.name = SavedName(
        file.get(), stem.substr(0, absl::AsciiStrToLower(stem).find(".tar")), packing.limits);
  }
  RETURN_IF_ERROR(PackWithManifest(
      image, kName, /*executable=*/false, {{"name", manifest.name}, {"image", kName}}, packing));
  return manifest;
}

// An archive is unpacked and packed again: so it is checked against every rule before it is sent,
// and what is sent is canonical.
absl::StatusOr<PolicyManifest> Repack(const std::string& source, const Packing& packing) {
  const std::string folder = packing.archive + ".unpacked";
  RETURN_IF_ERROR(UnpackSubmission(source, folder, packing.limits, packing.progress));
  absl::StatusOr<PolicyManifest> packed = PackFolder(folder, packing);
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  return packed;
}

bool HasArchiveName(const std::string& path) {
  const std::string lower = absl::AsciiStrToLower(path);
  for (const std::string_view ending : {".tar", ".tar.gz", ".tgz", ".tar.zst", ".tzst", ".tar.xz",
                                        ".txz", ".tar.bz2", ".tbz2", ".tbz", ".zip"}) {
    if (lower.ends_with(ending)) return true;
  }
  return false;
}

// Its first bytes tell what a file is: a name says little, as of `podman save -o walker`.
constexpr size_t kTarMagicAt = 257;

bool IsArchive(int file, std::string_view head) {
  return head.starts_with("PK\3\4") ||
         head.substr(std::min(head.size(), kTarMagicAt)) == "ustar" || IsCompressed(file);
}

// The name of the format of an archive that is not accepted; "": it is none.
std::string ForeignFormat(std::string_view head) {
  if (head.starts_with("7z\xbc\xaf")) return "7z";
  if (head.starts_with("Rar!")) return "RAR";
  return head.starts_with("\x04\x22\x4d\x18") ? "LZ4" : "";
}

absl::Status NoProgram(const std::string& path) {
  if (absl::AsciiStrToLower(path).ends_with(".py")) {
    return absl::InvalidArgumentError(
        "is a Python file, which can't run by itself; put it into a folder with a policy.json "
        "that gives the command: {\"name\": \"my policy\", \"command\": [\"python3\", "
        "\"policy.py\"], \"runtimes\": [\"python\"]}");
  }
  return absl::InvalidArgumentError(
      "is not a program (neither ELF nor a script with \"#!\") and not an archive; give a program, "
      "a folder with "
      "a policy.json, or an archive of one (.tar, .tar.gz, .tar.zst, .tar.xz, .tar.bz2, .zip)");
}

// Packs a single file.
absl::StatusOr<PolicyManifest> PackFile(const std::string& path, const struct stat& info,
                                        const Packing& packing) {
  const Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));  // waits for a lease on it to end
  if (!file.valid()) return Unreadable(path, FolderOf::kParticipant);
  std::array<char, kTarMagicAt + 5> bytes = {};
  const ssize_t got = ::pread(file.get(), bytes.data(), bytes.size(), 0);
  const std::string_view head(bytes.data(), static_cast<size_t>(std::max<ssize_t>(got, 0)));
  const bool program = ReadProgramHead(file.get()).kind != ProgramHead::Kind::kText;
  if (const std::string foreign = ForeignFormat(head); !foreign.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("is packed by ", foreign, ", which is not supported; pack it as .tar.gz, "
                     ".tar.zst, .tar.xz, .tar.bz2 or .zip"));
  }
  if ((!program && IsArchive(file.get(), head)) || HasArchiveName(path)) {
    return MayBeImageArchive(file.get()) ? PackImage(path, packing) : Repack(path, packing);
  }
  if (info.st_size == 0) return absl::InvalidArgumentError("is an empty file, not a program");
  if (!program) return NoProgram(path);
  if ((info.st_mode & 0111) == 0) {
    return absl::InvalidArgumentError("is not executable; set its bit with chmod +x");
  }
  return PackProgram(path, packing);
}

}  // namespace

absl::StatusOr<PolicyManifest> PackArtefact(const std::string& path, const std::string& archive,
                                            const ArtefactLimits& limits,
                                            const ByteProgress& progress,
                                            const std::string& name) {
  const Utf8Names utf8_names;
  if (!name.empty()) {
    RETURN_IF_ERROR(CleanName(name, "the name").status());
  }
  const Packing packing = {archive, limits, progress, name};
  struct stat info = {};
  if (::stat(path.c_str(), &info) != 0) {
    return absl::NotFoundError(absl::StrCat("can't be opened: ", std::strerror(errno)));
  }
  if (S_ISDIR(info.st_mode)) return PackFolder(path, packing);
  if (!S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError("is neither a file nor a folder");
  }
  return PackFile(path, info, packing);
}

absl::Status StreamArtefact(const std::string& folder, const std::string& digest,
                            const ByteSink& sink) {
  const Utf8Names utf8_names;
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!root.valid()) return HostError(absl::StrCat("can't open the submission's folder ", folder));
  Listing listing(kNoLimits);
  RETURN_IF_ERROR(ListFolder(root.get(), FolderOf::kDaemon, listing));
  TarWriter tar(sink);
  for (const auto& [path, entry] : listing.entries()) {
    RETURN_IF_ERROR(tar.Begin(path, entry));
    if (entry.type == EntryType::kFile) {
      const Fd file = OpenBeneath(root.get(), path, O_RDONLY | O_NONBLOCK);
      if (!file.valid()) return Unreadable(path, FolderOf::kDaemon);
      Sha256 hash;
      RETURN_IF_ERROR(tar.Copy(file.get(), path, entry.size, FolderOf::kDaemon,
                               [&](std::string_view piece) { hash.Update(piece); }));
      listing.at(path).sha256 = hash.FinishHex();
    }
  }
  RETURN_IF_ERROR(tar.Close());
  if (listing.Digest() == digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(
      "the submission's folder ", folder, " has files with the digest ", listing.Digest(),
      ", but should have ", digest, "; restore it from a backup, or have it submitted again"));
}

}  // namespace myograde::server
