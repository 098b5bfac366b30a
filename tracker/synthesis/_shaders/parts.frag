// Writes the number of the part, counted from 1.
flat in uint shown;
out uint id;

void main() {
    id = shown;
}
