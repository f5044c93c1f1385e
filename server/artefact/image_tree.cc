#include <archive_entry.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <climits>
#include <deque>
#include <functional>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/image_archive.h"
#include "server/artefact/listing.h"
#include "server/artefact/submission.h"

namespace myograde::server {
namespace {

constexpr int kMaxTreeLinks = 40;  // as in the kernel
constexpr size_t kMaxTopNames = 128;
constexpr int64_t kMaxUserFile = 1 << 20;
constexpr std::string_view kWhiteout = ".wh.";
constexpr std::string_view kOpaque = ".wh..wh..opq";
constexpr std::string_view kEngineOwn = ".wh..wh.";

absl::Status BadEntry(std::string_view path, absl::string_view rule) {
  return absl::InvalidArgumentError(absl::StrCat("the image's ", Quoted(path), " ", rule));
}

// An image's paths begin at its root, with or without a slash.
std::string_view FromRoot(std::string_view path) {
  return path.substr(std::min(path.find_first_not_of('/'), path.size()));
}

bool IsReplaced(const std::string& path) {
  return IsReplacedByTheSandbox(std::string_view(path).substr(0, path.find('/')));
}

// The file system of a container image, made from its layers in a folder.
//
// What a path means is decided by a list in memory, in which links are followed within the image;
// the file system itself is only ever used beneath the folder and through no link.
class ImageTree {
 public:
  // `root`: an empty folder, which must outlive it.
  ImageTree(int root, const ArtefactLimits& limits)
      : root_(root), limits_(limits), names_(limits) {}

  // Adds a layer on top of those before.
  absl::Status AddLayer(StreamArchive& layer) {
    ++layer_;
    for (;;) {
      archive_entry* entry = nullptr;
      ASSIGN_OR_RETURN(const bool found, layer.NextEntry(&entry));
      if (!found) return absl::OkStatus();
      // Layers name again what they change, so there may be more headers than files.
      if (++headers_ > 2 * limits_.files) return names_.TooManyEntries("its layers");
      RETURN_IF_ERROR(Take(layer, entry));
    }
  }

  // Makes the parts that every sandbox needs and looks up `user`; `image`'s working folder becomes
  // a real one. After it nothing may be added.
  absl::Status Finish(std::string_view user, PolicyImage& image) {
    ++layer_;
    if (nodes_.contains("etc") && !Has("etc", EntryType::kFolder)) {
      return BadEntry("/etc", "must be a folder, not a link or a file");
    }
    // The dynamic loader would load its libraries into the grader's programs too.
    if (nodes_.contains("etc/ld.so.preload")) {
      return BadEntry("/etc/ld.so.preload", "is not allowed; set LD_PRELOAD in the image's ENV");
    }
    RETURN_IF_ERROR(PlaceWorkingFolder(image));
    RETURN_IF_ERROR(Remove("etc/resolv.conf", /*itself=*/true, /*of_this_layer=*/true));
    RETURN_IF_ERROR(AddText("etc/hosts", kImageHosts));
    size_t tops = 0;
    for (const auto& [path, node] : nodes_) tops += path.find('/') == std::string::npos ? 1 : 0;
    if (tops > kMaxTopNames) {
      return BadEntry("/", absl::StrCat("has ", tops,
                                        " names; group them into folders, at most ",
                                        kMaxTopNames));
    }
    ASSIGN_OR_RETURN(const std::string passwd, ReadText("etc/passwd"));
    ASSIGN_OR_RETURN(const std::string group, ReadText("etc/group"));
    RETURN_IF_ERROR(FindUser(user, passwd, group, image));
    // Without such a folder the sandbox's own HOME serves better, which can be written.
    const std::string& home = image.environment["HOME"];
    const absl::StatusOr<std::string> real = Real(home, /*last=*/true);
    // The root has no node.
    const bool there = real.ok() && (real->empty() || Has(*real, EntryType::kFolder));
    if (!there || !home.starts_with('/')) image.environment.erase("HOME");
    return absl::OkStatus();
  }

  // Lists it below the folder kImageFolder.
  absl::Status ListIn(Listing& listing) const {
    for (const auto& [path, node] : nodes_) {
      ASSIGN_OR_RETURN(const std::string clean,
                       listing.CleanPath(absl::StrCat(kImageFolder, "/", path)));
      ASSIGN_OR_RETURN(Entry* const entry, listing.Add(clean, node.entry.type));
      *entry = node.entry;
      entry->stated = true;
      RETURN_IF_ERROR(listing.AddBytes(clean, node.entry.size));
    }
    return absl::OkStatus();
  }

 private:
  struct Node {
    Entry entry;
    int layer = 0;  // the last one that names it or something in it
  };

  absl::Status Take(StreamArchive& layer, archive_entry* entry) {
    const char* raw = archive_entry_pathname(entry);
    if (raw == nullptr) {
      return absl::InvalidArgumentError("a layer of the image has a name that is not UTF-8");
    }
    ASSIGN_OR_RETURN(const std::string clean, names_.CleanPath(FromRoot(raw)));
    if (clean.empty()) {
      return archive_entry_filetype(entry) == AE_IFDIR
                 ? absl::OkStatus()
                 : BadEntry("/", "is not a folder, and an image's top must be one");
    }
    ASSIGN_OR_RETURN(const std::string path, Real(clean, /*last=*/false));
    const std::string name = LastName(path);
    if (name == kOpaque) return Remove(FolderName(path), /*itself=*/false, /*of_this_layer=*/false);
    if (name.starts_with(kEngineOwn)) return absl::OkStatus();
    if (name.starts_with(kWhiteout)) {
      return Whiteout(FolderName(path), name.substr(kWhiteout.size()));
    }
    if (IsReplaced(path)) return absl::OkStatus();
    return Put(path, layer, entry);
  }

  absl::Status Whiteout(const std::string& folder, const std::string& name) {
    if (name.empty() || name == "." || name == "..") {
      return BadEntry(Joined(folder, std::string(kWhiteout) + name),
                      "removes no name, so it is not a valid whiteout; save the image again");
    }
    return Remove(Joined(folder, name), /*itself=*/true, /*of_this_layer=*/false);
  }

  absl::Status Put(const std::string& path, StreamArchive& layer, archive_entry* entry) {
    const char* hard_link = archive_entry_hardlink(entry);
    const mode_t type = archive_entry_filetype(entry);
    const bool folder = hard_link == nullptr && type == AE_IFDIR;
    if (folder && Has(path, EntryType::kFolder)) {
      nodes_.at(path).layer = layer_;
      return MakeParents(path);
    }
    if (hard_link != nullptr) return PutHardLink(path, hard_link);
    if (type != AE_IFDIR && type != AE_IFREG && type != AE_IFLNK) {
      return BadEntry(path, "is a device node, a named pipe or a socket; images may have devices "
                            "only in /dev, which the sandbox replaces with its own");
    }
    RETURN_IF_ERROR(Remove(path, /*itself=*/true, /*of_this_layer=*/true));
    RETURN_IF_ERROR(MakeParents(path));
    if (folder) return MakeFolder(path);
    if (type == AE_IFREG) return PutFile(path, layer, entry);
    const char* target = archive_entry_symlink(entry);
    return PutLink(path, target == nullptr ? "" : target);
  }

  bool Has(const std::string& path, EntryType type) const {
    const auto found = nodes_.find(path);
    return found != nodes_.end() && found->second.entry.type == type;
  }

  absl::Status PutFile(const std::string& path, StreamArchive& layer,
                                  archive_entry* entry) {
    Entry about = {.executable = (archive_entry_perm(entry) & 0111) != 0,
                   .time = KeptTime(archive_entry_mtime(entry))};
    // A claimed size proves nothing, but one above the limit can be rejected at once.
    if (archive_entry_size_is_set(entry) != 0) {
      RETURN_IF_ERROR(names_.CheckRoom(path, archive_entry_size(entry)));
    }
    return Write(path, std::move(about), [&] { return layer.NextData(); });
  }

  absl::Status PutHardLink(const std::string& path, const std::string& target) {
    ASSIGN_OR_RETURN(const std::string clean, names_.CleanPath(FromRoot(target)));
    ASSIGN_OR_RETURN(const std::string real, Real(clean, /*last=*/false));
    if (real == path) return absl::OkStatus();
    RETURN_IF_ERROR(Remove(path, /*itself=*/true, /*of_this_layer=*/true));
    if (!nodes_.contains(real) || Has(real, EntryType::kFolder)) {
      return BadEntry(path, absl::StrCat("is a hard link to ", Quoted(target),
                                         ", which is not a file of the image"));
    }
    RETURN_IF_ERROR(MakeParents(path));
    const Entry original = nodes_.at(real).entry;
    if (original.type == EntryType::kLink) return PutLink(path, original.target);
    // A copy: the file system's own links could be made to lead elsewhere, and need a further
    // system call. Equal files share their place on the disk later (share_files.h).
    const Fd source = OpenBeneath(root_, real, O_RDONLY | O_NONBLOCK);
    if (!source.valid()) return HostError(absl::StrCat("can't open the file ", Quoted(real)));
    FileStream bytes(source.get());
    return Write(path, Entry{.executable = original.executable, .time = original.time},
                 [&] { return bytes.Next(); });
  }

  absl::Status PutLink(const std::string& path, const std::string& target) {
    if (target.empty() || target.size() >= PATH_MAX) {
      return BadEntry(path, "is a symbolic link without a target, or with one that is too long");
    }
    RETURN_IF_ERROR(CheckLinkText(path, target));
    RETURN_IF_ERROR(Add(path, {.type = EntryType::kLink, .target = target}).status());
    return MakeLinkBeneath(root_, path, target);
  }

  // `next` yields content until it yields nothing.
  absl::Status Write(const std::string& path, Entry about,
                                const std::function<absl::StatusOr<std::string_view>()>& next) {
    ASSIGN_OR_RETURN(Node* const node, Add(path, std::move(about)));
    return MakeFileBeneath(root_, path, node->entry, [&]() -> absl::StatusOr<std::string_view> {
      ASSIGN_OR_RETURN(const std::string_view piece, next());
      RETURN_IF_ERROR(names_.AddBytes(path, std::ssize(piece)));
      return piece;
    });
  }

  // `path` with the links of its folders followed within the image; with `last` also of its last
  // name.
  absl::StatusOr<std::string> Real(const std::string& path, bool last) const {
    std::deque<std::string> names = absl::StrSplit(path, '/');
    std::string at;
    int links = 0;
    while (!names.empty()) {
      const std::string name = names.front();
      names.pop_front();
      if (name.empty() || name == ".") continue;
      if (name == "..") {
        at = FolderName(at);  // the root's own is the root
        continue;
      }
      const std::string next = Joined(at, name);
      if (!Has(next, EntryType::kLink) || (names.empty() && !last)) {
        if (Has(next, EntryType::kFile) && !names.empty()) {
          return BadEntry(path, absl::StrCat("is below ", Quoted(next), ", which is not a folder"));
        }
        at = next;
        continue;
      }
      if (++links > kMaxTreeLinks) return BadEntry(path, "leads through a loop of symbolic links");
      const std::string& target = nodes_.at(next).entry.target;
      if (target.starts_with('/')) at.clear();
      const std::vector<std::string> more = absl::StrSplit(target, '/');
      names.insert(names.begin(), more.begin(), more.end());
      if (names.size() > PATH_MAX) return BadEntry(path, "leads through links that are too long");
    }
    return names_.CleanPath(at);  // links can make it too deep
  }

  // Makes the folders above `path`, whose folders are real, and notes that this layer uses them.
  absl::Status MakeParents(const std::string& path) {
    for (size_t slash = path.find('/'); slash != std::string::npos;
         slash = path.find('/', slash + 1)) {
      const std::string above = path.substr(0, slash);
      if (!nodes_.contains(above)) RETURN_IF_ERROR(MakeFolder(above));
      nodes_.at(above).layer = layer_;
    }
    return absl::OkStatus();
  }

  absl::Status MakeFolder(const std::string& path) {
    RETURN_IF_ERROR(Add(path, {.type = EntryType::kFolder}).status());
    return MakeFolderBeneath(root_, path);
  }

  absl::StatusOr<Node*> Add(const std::string& path, Entry entry) {
    if (static_cast<int64_t>(nodes_.size()) >= limits_.files) return names_.TooManyEntries(path);
    const auto [node, added] = nodes_.try_emplace(path, Node{std::move(entry), layer_});
    if (!added) return absl::InternalError("the image's tree has an entry twice");
    return &node->second;
  }

  // Removes what layers below this one have at or in `path`, or all of it.
  absl::Status Remove(const std::string& path, bool itself, bool of_this_layer) {
    std::vector<std::string> chosen;
    if (itself && nodes_.contains(path)) chosen.push_back(path);
    // '0' follows '/'.
    auto below = path.empty() ? nodes_.begin() : nodes_.lower_bound(path + "/");
    const auto end = path.empty() ? nodes_.end() : nodes_.lower_bound(path + "0");
    for (; below != end; ++below) chosen.push_back(below->first);
    // What is in a folder comes after it. A folder that this layer uses stays, and so do those
    // above. (Without std::views, whose form in GCC 12's library clang 14 can't compile.)
    for (auto one = chosen.rbegin(); one != chosen.rend(); ++one) {
      if (!of_this_layer && nodes_.at(*one).layer == layer_) continue;
      RETURN_IF_ERROR(RemoveOne(*one));
    }
    return absl::OkStatus();
  }

  absl::Status RemoveOne(const std::string& path) {
    ASSIGN_OR_RETURN(const Fd folder, OpenFolderOf(root_, path));
    const int how = Has(path, EntryType::kFolder) ? AT_REMOVEDIR : 0;
    if (::unlinkat(folder.get(), LastName(path).c_str(), how) != 0) {
      return HostError(absl::StrCat("can't remove ", Quoted(path)));
    }
    nodes_.erase(path);
    return absl::OkStatus();
  }

  // The content of a file that may be missing; at most 1 MiB of it.
  absl::StatusOr<std::string> ReadText(const std::string& path) const {
    ASSIGN_OR_RETURN(const std::string real, Real(path, /*last=*/true));
    if (!Has(real, EntryType::kFile)) return std::string();
    if (nodes_.at(real).entry.size > kMaxUserFile) {
      return BadEntry(path, absl::StrCat("has more than ", kMaxUserFile, " bytes"));
    }
    const Fd file = OpenBeneath(root_, real, O_RDONLY | O_NONBLOCK);
    if (!file.valid()) return HostError(absl::StrCat("can't open the file ", Quoted(real)));
    return ReadAll(file.get(), path);
  }

  absl::Status AddText(const std::string& path, std::string_view text) {
    RETURN_IF_ERROR(Remove(path, /*itself=*/true, /*of_this_layer=*/true));
    RETURN_IF_ERROR(MakeParents(path));
    return Write(path, Entry{}, [&] { return std::exchange(text, std::string_view()); });
  }

  absl::Status PlaceWorkingFolder(PolicyImage& image) {
    ASSIGN_OR_RETURN(const std::string clean, names_.CleanPath(FromRoot(image.working_dir)));
    ASSIGN_OR_RETURN(const std::string real, Real(clean, /*last=*/true));
    image.working_dir = "/" + real;
    if (real.empty() || real == "tmp") return absl::OkStatus();
    if (IsReplaced(real)) {
      return BadEntry(image.working_dir,
                      "is its working folder, which the sandbox replaces with its own; choose "
                      "another WORKDIR");
    }
    // Engines make it if it is missing.
    const bool there = nodes_.contains(real);
    if (there && !Has(real, EntryType::kFolder)) {
      return BadEntry(image.working_dir, "is its working folder, but not a folder");
    }
    RETURN_IF_ERROR(MakeParents(real));
    return there ? absl::OkStatus() : MakeFolder(real);
  }

  const int root_;
  const ArtefactLimits limits_;
  Listing names_;  // rules for names and the total of bytes; holds no entries
  std::map<std::string, Node> nodes_;
  int layer_ = 0;
  int64_t headers_ = 0;
};

absl::Status CheckLayer(const CheckedStream& packed, const CheckedStream& tar,
                        const ImageLayer& layer) {
  if (layer.size >= 0 && packed.size() != layer.size) {
    return absl::InvalidArgumentError(absl::StrCat(
        "has ", packed.size(), " bytes where its archive states ", layer.size,
        "; save the image again"));
  }
  if (!layer.sha256.empty() && packed.sha256() != layer.sha256) {
    return absl::InvalidArgumentError(
        "has a different digest than its archive states; save the image again");
  }
  if (tar.sha256() != layer.diff_id) {
    return absl::InvalidArgumentError(
        "has different content than the image's config states (diff_ids); save the image again");
  }
  return absl::OkStatus();
}

// Adds one layer, which is decompressed and hashed on its way. `place`: "2 of 5".
absl::Status AddLayer(const ImageArchive& archive, const ImageLayer& layer,
                      const std::string& place, int64_t& left, ImageTree& tree) {
  MemberStream member = archive.Open(layer.member);
  int64_t packed_left = archive.SizeOf(layer.member);
  CheckedStream packed(member, "it", packed_left);
  EntryStream decompressed(packed);
  CheckedStream tar(decompressed, "it", left);
  StreamArchive entries(tar, StreamArchive::Form::kTar);
  absl::Status status = entries.Open();
  if (status.ok()) status = tree.AddLayer(entries);
  if (status.ok()) status = tar.Finish();
  if (status.ok()) status = packed.Finish();
  if (status.ok()) status = CheckLayer(packed, tar, layer);
  return About(absl::StrCat("the image's layer ", place), status);
}

// Writes the policy.json of the artefact and adds it to the listing.
absl::Status WriteManifest(int folder, const std::string& text, Listing& listing) {
  ASSIGN_OR_RETURN(Entry* const entry, listing.Add("policy.json", EntryType::kFile));
  RETURN_IF_ERROR(listing.AddBytes("policy.json", std::ssize(text)));
  std::string_view left = text;
  return MakeFileBeneath(folder, "policy.json", *entry,
                         [&] { return std::exchange(left, std::string_view()); });
}

}  // namespace

absl::StatusOr<Artefact> MakeImage(const ImageArchive& archive, ImageContent content, int folder,
                                   nlohmann::json manifest, const ArtefactLimits& limits) {
  RETURN_IF_ERROR(MakeFolderBeneath(folder, kImageFolder));
  const Fd root = OpenBeneath(folder, kImageFolder, O_RDONLY | O_DIRECTORY);
  if (!root.valid()) return HostError("can't open the image's folder");
  ImageTree tree(root.get(), limits);
  int64_t left = StreamLimit(limits);
  for (size_t i = 0; i < content.layers.size(); ++i) {
    const std::string place = absl::StrCat(i + 1, " of ", content.layers.size());
    RETURN_IF_ERROR(AddLayer(archive, content.layers[i], place, left, tree));
  }
  PolicyImage& image = content.config.image;
  RETURN_IF_ERROR(tree.Finish(content.config.user, image));
  if (!manifest.contains("name")) {
    manifest["name"] = content.tag.empty() ? "image" : NameOfTag(content.tag);
  }
  if (!manifest.contains("command")) manifest["command"] = content.config.command;
  if (manifest["command"].empty()) {
    return absl::InvalidArgumentError("the image has neither ENTRYPOINT nor CMD; build it with "
                                      "one, or give a \"command\" in policy.json");
  }
  manifest["image"] = PolicyImageToJson(image);
  ASSIGN_OR_RETURN(PolicyManifest parsed, ParseManifest(manifest));
  Listing listing(limits);
  RETURN_IF_ERROR(tree.ListIn(listing));
  RETURN_IF_ERROR(WriteManifest(folder, CanonicalJson(manifest) + "\n", listing));
  return Artefact{.digest = listing.Digest(),
                  .manifest = std::move(parsed),
                  .bytes = listing.bytes(),
                  .files = static_cast<int64_t>(listing.entries().size())};
}

}  // namespace myograde::server
