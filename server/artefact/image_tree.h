// The file system of a container image, made from its layers in a folder.
//
// What a path means is decided by a list in memory, in which links are followed within the image;
// the file system itself is only ever used beneath the folder and through no link.
#pragma once

#include <archive_entry.h>

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/lease/policy_image.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/listing.h"

namespace myograde::server {

class ImageTree {
 public:
  // `root`: an empty folder, which must outlive it.
  ImageTree(int root, const ArtefactLimits& limits) : root_(root), limits_(limits), names_(limits) {}

  // Adds a layer on top of those before.
  absl::Status AddLayer(StreamArchive& layer);

  // Makes the parts that every sandbox needs and looks up `user`; `image`'s working folder becomes
  // a real one. After it nothing may be added.
  absl::Status Finish(std::string_view user, PolicyImage& image);

  // Lists it below the folder kImageFolder.
  absl::Status ListIn(Listing& listing) const;

 private:
  struct Node {
    Entry entry;
    int layer = 0;  // the last one that names it or something in it
  };

  absl::Status Take(StreamArchive& layer, archive_entry* entry);
  absl::Status Put(const std::string& path, StreamArchive& layer, archive_entry* entry);
  absl::Status PutFile(const std::string& path, StreamArchive& layer, archive_entry* entry);
  absl::Status PutHardLink(const std::string& path, const std::string& target);
  absl::Status PutLink(const std::string& path, const std::string& target);
  // `next` yields content until it yields nothing.
  absl::Status Write(const std::string& path, Entry about,
                     const std::function<absl::StatusOr<std::string_view>()>& next);
  absl::Status Whiteout(const std::string& folder, const std::string& name);

  // `path` with the links of its folders followed within the image; with `last` also of its last
  // name.
  absl::StatusOr<std::string> Real(const std::string& path, bool last) const;
  // Makes the folders above `path`, whose folders are real, and notes that this layer uses them.
  absl::Status MakeFoldersOf(const std::string& path);
  absl::Status MakeFolder(const std::string& path);
  absl::StatusOr<Node*> Add(const std::string& path, Entry entry);
  // Removes what layers below this one have at or in `path`, or all of it.
  absl::Status Remove(const std::string& path, bool itself, bool of_this_layer);
  absl::Status RemoveOne(const std::string& path);
  std::vector<std::string> Below(const std::string& path) const;
  absl::Status AddText(const std::string& path, std::string_view text);
  // The content of a file that may be missing; at most 1 MiB of it.
  absl::StatusOr<std::string> ReadText(const std::string& path) const;
  absl::Status PlaceWorkingFolder(PolicyImage& image);

  const int root_;
  const ArtefactLimits limits_;
  Listing names_;  // rules for names and the total of bytes; holds no entries
  std::map<std::string, Node> nodes_;
  int layer_ = 0;
  int64_t headers_ = 0;
};

}  // namespace myograde::server
