// The map: drawn when it is looked at.
export {};
