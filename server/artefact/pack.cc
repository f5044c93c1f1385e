#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <functional>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/program_head.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/artefact.h"
#include "server/artefact/beneath.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/image_submission.h"
#include "server/artefact/listing.h"
#include "server/artefact/submitted_manifest.h"
#include "server/artefact/tar_writer.h"
#include "server/base/names.h"

namespace myograde::server {
namespace {

constexpr char kManifestFile[] = "policy.json";

// What PackArtefact was asked for.
struct Packing {
  const std::string& archive;
  const ArtefactLimits& limits;
  const ByteProgress& progress;
  const std::string& name;  // "": the submission's own
};

absl::StatusOr<Fd> NewArchive(const std::string& path) {
  Fd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
  if (!file.valid()) return HostError(absl::StrCat("can't write the archive ", path));
  return file;
}

TarWriter::Sink SinkOf(const Fd& file) {
  return [fd = file.get()](std::string_view bytes) {
    return WriteAll(fd, bytes).ok() ? absl::OkStatus() : HostError("can't write the archive");
  };
}

// The text of a policy.json that is made or changed here.
std::string ManifestText(const nlohmann::json& manifest) {
  return manifest.dump(2, ' ', false, nlohmann::json::error_handler_t::ignore) + "\n";
}

// Writes the listed files, which `open` opens. `about`: what to write as policy.json; "": the file
// itself.
absl::Status WriteListed(const Listing& listing, const std::string& about, const Packing& packing,
                         const std::function<Fd(const std::string& path)>& open) {
  ASSIGN_OR_RETURN(const Fd archive, NewArchive(packing.archive));
  TarWriter tar(SinkOf(archive));
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

absl::StatusOr<ArtefactManifest> PackFolder(const std::string& folder, const Packing& packing) {
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

absl::StatusOr<ArtefactManifest> PackProgram(const std::string& program, const Packing& packing) {
  const std::string base = std::filesystem::path(program).filename().string();
  ArtefactManifest manifest;
  manifest.name = packing.name.empty() ? PolicyNameOf(base) : packing.name;
  manifest.command = {"./" + base};
  RETURN_IF_ERROR(PackWithManifest(program, base, /*executable=*/true,
                       {{"name", manifest.name}, {"command", manifest.command}}, packing));
  return manifest;
}

// An image is sent as it is: the daemon unpacks it, and checks it there.
absl::StatusOr<ArtefactManifest> PackImage(const std::string& image, const Packing& packing) {
  constexpr char kName[] = "image.tar";
  ArtefactManifest manifest;
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
absl::StatusOr<ArtefactManifest> Repack(const std::string& source, const Packing& packing) {
  const std::string folder = packing.archive + ".unpacked";
  RETURN_IF_ERROR(UnpackSubmission(source, folder, packing.limits, packing.progress));
  absl::StatusOr<ArtefactManifest> packed = PackFolder(folder, packing);
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

// What one file is, by its first bytes: a name says little, as of `podman save -o walker`.
enum class FileKind { kProgram, kArchive, kForeignArchive, kOther };
struct KnownFile {
  FileKind kind = FileKind::kOther;
  std::string_view name = {};  // kForeignArchive: of its format
};

KnownFile KindOf(int file) {
  constexpr size_t kTarMagicAt = 257;
  std::array<char, kTarMagicAt + 5> bytes = {};
  const ssize_t got = ::pread(file, bytes.data(), bytes.size(), 0);
  const std::string_view head(bytes.data(), static_cast<size_t>(std::max<ssize_t>(got, 0)));
  if (ReadProgramHead(file).kind != ProgramHead::Kind::kText) return {FileKind::kProgram};
  if (head.starts_with("PK\3\4") || head.substr(std::min(head.size(), kTarMagicAt)) == "ustar" ||
      IsCompressed(file)) {
    return {FileKind::kArchive};
  }
  for (const auto& [magic, name] : {std::pair<std::string_view, std::string_view>{"7z\xbc\xaf", "7z"},
                                    {"Rar!", "RAR"}, {"\x04\x22\x4d\x18", "LZ4"}}) {
    if (head.starts_with(magic)) return {FileKind::kForeignArchive, name};
  }
  return {};
}

absl::Status NoProgram(const std::string& path) {
  if (absl::AsciiStrToLower(path).ends_with(".py")) {
    return absl::InvalidArgumentError(
        "is a Python file, which can't start by itself; put it into a folder with a policy.json that names "
        "the command: {\"name\": \"my policy\", \"command\": [\"python3\", \"policy.py\"], \"runtimes\": "
        "[\"python\"]}");
  }
  return absl::InvalidArgumentError(
      "is no program (neither ELF nor a script with \"#!\") and no archive; give a program, a folder with "
      "a policy.json, or an archive of one (.tar, .tar.gz, .tar.zst, .tar.xz, .tar.bz2, .zip)");
}

// Packs a single file.
absl::StatusOr<ArtefactManifest> PackFile(const std::string& path, const struct stat& info,
                                          const Packing& packing) {
  const Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));  // waits for a lease on it to end
  if (!file.valid()) return Unreadable(path, FolderOf::kParticipant);
  const KnownFile known = KindOf(file.get());
  if (known.kind == FileKind::kForeignArchive) {
    return absl::InvalidArgumentError(
        absl::StrCat("is packed by ", absl::string_view(known.name.data(), known.name.size()),
                     ", which is not accepted; pack it as .tar.gz, .tar.zst, .tar.xz, .tar.bz2 or .zip"));
  }
  if (known.kind == FileKind::kArchive || HasArchiveName(path)) {
    return MayBeImageArchive(file.get()) ? PackImage(path, packing) : Repack(path, packing);
  }
  if (info.st_size == 0) return absl::InvalidArgumentError("is an empty file, not a program");
  if (known.kind != FileKind::kProgram) return NoProgram(path);
  if ((info.st_mode & 0111) == 0) {
    return absl::InvalidArgumentError("is not executable; set its bit with chmod +x");
  }
  return PackProgram(path, packing);
}

}  // namespace

absl::StatusOr<ArtefactManifest> PackArtefact(const std::string& path, const std::string& archive,
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

}  // namespace myograde::server
