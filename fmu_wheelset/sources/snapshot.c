#include "snapshot.h"

#include <stdlib.h>
#include <string.h>

/* What precedes a component as bytes. The token stands for sources and table, the size for the memory layout,
 * and the checksum for bytes that were changed on the way. */
typedef struct {
    char token[48];
    uint64_t size, checksum;
} Header;

/* FNV-1a over 64 bits. */
static uint64_t checksum(const Component *component)
{
    const unsigned char *byte = (const unsigned char *)component;
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < sizeof *component; i++)
        hash = (hash ^ byte[i]) * 1099511628211u;
    return hash;
}

static Header header_of(const Component *component)
{
    Header header = {{0}, sizeof *component, checksum(component)};
    strncpy(header.token, INSTANTIATION_TOKEN, sizeof header.token - 1);
    return header;
}

static Status missing(Instance *instance, const char *what)
{
    return component_fail(instance, "FMU state: got a null pointer, expected %s", what);
}

/* Memory for a snapshot, unless there is some already. */
static Status allocate(Instance *instance, void **snapshot)
{
    if (!*snapshot)
        *snapshot = malloc(sizeof(Component));
    return *snapshot ? STATUS_OK : component_fail(instance, "FMU state: got no memory for %lu bytes",
                                                  (unsigned long)sizeof(Component));
}

Status snapshot_take(Instance *instance, void **snapshot)
{
    if (!snapshot)
        return missing(instance, "where to store the state");
    if (allocate(instance, snapshot) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(*snapshot, &instance->component, sizeof instance->component);
    return STATUS_OK;
}

Status snapshot_restore(Instance *instance, const void *snapshot)
{
    if (!snapshot)
        return missing(instance, "a state that was got before");
    const Component *component = snapshot;
    if (component->interface != instance->component.interface)
        return component_fail(instance, "FMU state: got one of the other interface type; co-simulation and "
                              "model exchange cannot continue each other");
    instance->component = *component;
    return STATUS_OK;
}

Status snapshot_free(void **snapshot)
{
    if (snapshot) {
        free(*snapshot);
        *snapshot = 0;
    }
    return STATUS_OK;
}

Status snapshot_size(Instance *instance, const void *snapshot, size_t *size)
{
    if (!snapshot || !size)
        return missing(instance, "a state and where to store its size");
    *size = sizeof(Header) + sizeof(Component);
    return STATUS_OK;
}

static Status check_size(Instance *instance, size_t size)
{
    const size_t expected = sizeof(Header) + sizeof(Component);
    if (size == expected)
        return STATUS_OK;
    return component_fail(instance, "FMU state: got %lu bytes, expected %lu", (unsigned long)size,
                          (unsigned long)expected);
}

Status snapshot_write(Instance *instance, const void *snapshot, void *bytes, size_t size)
{
    if (!snapshot || !bytes)
        return missing(instance, "a state and where to store its bytes");
    if (check_size(instance, size) != STATUS_OK)
        return STATUS_ERROR;
    const Header header = header_of(snapshot);
    memcpy(bytes, &header, sizeof header);
    memcpy((char *)bytes + sizeof header, snapshot, sizeof(Component));
    return STATUS_OK;
}

Status snapshot_read(Instance *instance, const void *bytes, size_t size, void **snapshot)
{
    Component component;
    if (!bytes || !snapshot)
        return missing(instance, "bytes and where to store the state");
    if (check_size(instance, size) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(&component, (const char *)bytes + sizeof(Header), sizeof component);
    const Header header = header_of(&component);
    if (memcmp(&header, bytes, sizeof header) != 0)
        return component_fail(instance, "FMU state: got bytes that are damaged or of another build, expected "
                              "those of %s", INSTANTIATION_TOKEN);
    if (allocate(instance, snapshot) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(*snapshot, &component, sizeof component);
    return STATUS_OK;
}
