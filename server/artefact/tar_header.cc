#include "server/artefact/tar_header.h"

namespace myograde::server {

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

}  // namespace myograde::server
