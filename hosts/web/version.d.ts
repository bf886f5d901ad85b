/** Changes with every build whose variants may be others: variants that you keep belong to it. */
export const version: string;
